"""The architecture, held by a machine: who may import whom, how long files are, what they say first."""

import ast
import re
from pathlib import Path

import pytest

from tests.imports import MARKS, MODULES, PACKAGE, PAGE, ROOT, TESTS, imported_parts, picture

MAX_LINES = 400

ALLOWED = {
    "can": set(),
    "model": set(),
    "objects": {"can", "model"},
    "config": {"model", "objects", "robot"},
    "estimate": {"model"},
    "robot": {"model"},
    "node": {"can", "model", "objects"},
    "bus": {"can"},
    "sim": {"can", "model", "objects", "config", "node", "robot"},
    "master": {"can", "model", "objects", "config", "node", "estimate", "robot"},
    "planning": {"can", "model", "objects", "config", "estimate"},
    "study": {
        "can",
        "model",
        "objects",
        "config",
        "node",
        "estimate",
        "robot",
        "sim",
        "master",
        "planning",
    },
    "skin": {
        "can",
        "model",
        "objects",
        "config",
        "node",
        "estimate",
        "robot",
        "bus",
        "sim",
        "master",
        "planning",
        "study",
    },
    "view": {"can", "model", "objects", "config", "robot", "skin"},
}
FREE = {
    "cli",
    "__init__.py",
    "__main__.py",
    "errors.py",
    "jit",
    "lazy.py",
    "printable.py",
}  # all parts, or none by their nature
EVERYONE_MAY = {"errors", "jit", "lazy", "printable"}


TESTED_BY = {
    "estimate/presses/test_gate.py": "estimate/presses/alignment estimate/presses/cross_validation "
    "estimate/presses/kinds estimate/presses/pose estimate/presses/spread "
    "estimate/presses/table estimate/presses/zeros",
    "estimate/test_response.py": "estimate/levels/cell_division estimate/levels/posterior "
    "estimate/levels/posterior_cell "
    "estimate/press_readings estimate/response_algebra estimate/response_covariance "
    "estimate/smooth_residuals study/surrogate",
    "estimate/levels/test_model_selection.py": "estimate/levels/alike estimate/levels/worth",
    "estimate/levels/test_orphans.py": "estimate/levels/missing_touch",
    "objects/test_board_calibration.py": "model/residual_map objects/residual_map",
    "jit/test_kernel_files.py": "jit/internals",
    "bus/test_loop.py": "bus/managed_interface bus/realtime",
    "cli/test_host.py": "bus/core_thread",
    "skin/test_simulated.py": "skin/contact skin/cycle skin/master_cycles skin/touch",
    "skin/test_shared_memory.py": "skin/shared_object",
    "skin/test_skin.py": "skin/feed",
    "skin/test_robot_here.py": "skin/layout",
    "socketcan/test_bus.py": "bus/opening bus/socketcan_abi bus/socketcan_batch",
    "can/test_virtual_bus.py": "can/clock can/core can/event can/frame can/virtual_buses",
    "bus/test_interface_counters.py": "can/error_frames",
    "cli/test_cli_help.py": "__main__ cli/commands/demo cli/options",
    "cli/commands/test_run.py": "cli/commands/monitor cli/commands/sim",
    "cli/commands/test_export.py": "cli/export/capture cli/export/dbc_of cli/export/mcap_file "
    "cli/export/new_file cli/export/parquet cli/export/recompute cli/export/rows cli/export/scene "
    "cli/export/schemas cli/export/tables",
    "cli/test_study_report.py": "cli/pages/accuracy cli/pages/page cli/pages/plot",
    "cli/commands/test_doctor.py": "cli/diagnostics cli/notify",
    "cli/commands/test_presses.py": "cli/columns",
    "cli/commands/test_calibrate.py": "cli/pages/calibration cli/calibration_text cli/press_csv",
    "cli/commands/test_replay.py": "cli/replay_report skin/recording",
    "cli/commands/test_scene.py": "cli/progress sim/bare_skin sim/catalogue sim/scaling",
    "planning/test_plan.py": "cli/commands/plan",
    "planning/test_schedule.py": "planning/traffic",
    "config/test_arm_file.py": "config/arm_tables config/placement",
    "config/test_robot_tables.py": "model/robot",
    "robot/test_frames.py": "robot/kernels",
    "master/test_replay.py": "master/recorded_sync",
    "master/test_robot.py": "config/drives objects/drives robot/records",
    "robot/test_urdf.py": "robot/chain",
    "sim/test_joint_motion.py": "sim/drives",
    "config/test_system.py": "config/parameters errors objects/bus_load",
    "test_package.py": "lazy",
    "estimate/test_baseline.py": "estimate/kernels/zeros estimate/kernels/zero_columns",
    "estimate/test_baseline_noisy_start.py": "estimate/kernels/zero_noise",
    "estimate/test_plausibility.py": "estimate/kernels/plausible estimate/kernels/judged_columns "
    "estimate/kernels/neighbours estimate/kernels/silence",
    "estimate/test_plausibility_repeated.py": "estimate/kernels/stopped estimate/kernels/copied",
    "estimate/test_estimator_offsets.py": "estimate/kernels/board_offset estimate/levels/shifted_board",
    "estimate/levels/test_contact_shape.py": "estimate/levels/long_contact",
    "estimate/test_estimator_sizes.py": "estimate/levels/contact_size estimate/levels/learned_size "
    "estimate/levels/sized_answers estimate/kernels/sized_contacts",
    "estimate/test_loads.py": "estimate/kernels/load_sums estimate/load_areas estimate/load_errors",
    "master/test_master_loads.py": "master/load_objects",
    "hard/test_catalogue.py": "estimate/contacts estimate/levels/contact_width estimate/levels/split_merge",
    "hard/test_doors.py": "estimate/kernels/board_places estimate/kernels/constants "
    "estimate/kernels/workspace",
    "hard/test_oracles.py": "estimate/kernels/constants estimate/kernels/covariance estimate/kernels/groups "
    "estimate/kernels/least_squares estimate/kernels/listed estimate/kernels/normal_equations "
    "estimate/levels/modes estimate/levels/profile_likelihood",
    "estimate/test_estimator_limit.py": "estimate/levels/fit",
    "estimate/levels/test_kmeans.py": "estimate/levels/merge",
    "estimate/levels/test_posterior.py": "estimate/levels/listed_fit estimate/levels/other_starts",
    "estimate/tracking/test_tracker.py": "estimate/tracking/measurements estimate/tracking/state",
    "master/commissioning/test_press_guide.py": "estimate/presses/enough master/commissioning/press_dialogue",
    "master/test_master.py": "master/cycle_report",
    "master/patches/test_supervisor.py": "master/alarms master/patches/boots master/patches/passive_monitor",
    "master/patches/test_supervisor_missed_errors.py": "master/patches/patch_errors",
    "master/patches/test_provisioning.py": "master/commissioning/sessions master/patches/expected_nodes",
    "master/commissioning/test_identification.py": "master/commissioning/board_presses "
    "master/commissioning/board_turn master/commissioning/identified_arm",
    "master/test_health.py": "master/gain_watch master/health_findings",
    "cli/commands/test_health.py": "cli/health_keeper",
    "cli/test_state_keeper.py": "cli/kept_file",
    "cli/commands/test_identify.py": "cli/typed_lines",
    "master/commissioning/test_node_id_assignment.py": "master/commissioning/lss",
    "hard/test_bytes.py": "master/cycle master/publish",
    "model/test_arm.py": "model/patch",
    "robot/test_mesh_link.py": "model/mesh_surface robot/flattening",
    "node/test_node_conformance.py": "node/context node/dictionary node/emcy node/heartbeat "
    "node/heartbeat_consumer node/layout node/lss node/mapping node/nmt node/node_guarding node/pdo_rules "
    "node/rpdo node/sample_stamp node/sdo_block node/sdo_server node/storage node/sync node/tpdo "
    "node/triggers node/values node/verify",
    "objects/test_profile.py": "objects/cia",
    "objects/test_eds.py": "objects/eds_file objects/eds_values objects/file_bytes",
    "objects/test_eds_lint.py": "objects/eds_lint_pdo",
    "cli/test_profile_page.py": "cli/commands/profile",
    "master/commissioning/test_patch_check.py": "master/commissioning/patch_rules",
    "skin/test_listened.py": "skin/listened_readings skin/listener",
    "view/web/test_page.py": "skin/blind view/web/playback view/web/server view/web/stage",
    "view/web/test_player.py": "skin/film",
    "cli/test_live.py": "objects/published view/table view/unrolled",
    "sim/test_world.py": "sim/boards sim/clock sim/player sim/sampler",
    "sim/effects/test_effects_all.py": "sim/effect sim/held",
    "sim/test_layer_elastic.py": "sim/bonded_layer sim/round_tables",
    "sim/effects/test_response.py": "sim/layer_response",
    "sim/effects/test_shear.py": "sim/layer_shear",
    "sim/test_touch.py": "sim/indenter sim/laws sim/touch_table",
    "study/test_accuracy.py": "cli/study_estimator study/accuracy_draws study/accuracy_table "
    "study/accuracy_time study/crb study/marked study/skin_models",
    "cli/commands/test_coverage.py": "study/coverage_picture",
    "study/test_generic_law.py": "cli/study_law",
    "study/test_sweep.py": "cli/commands/study cli/figures study/cases study/cell study/methods",
    "study/test_front_quick.py": "study/compare",
    "study/test_headline.py": "cli/study_headline study/headline_figure",
    "study/test_end_to_end.py": "study/event_driven study/instant",
    "study/test_paper.py": "study/draw study/paper_figures",
}
"""Modules without a test file of their own name: which file under tests/ covers them."""


def relative(path: Path) -> str:
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_module_imports_only_what_the_design_allows(path):
    part = path.relative_to(PACKAGE).parts[0]
    if part in FREE:
        return
    extra = imported_parts(path) - ALLOWED[part] - EVERYONE_MAY - {part}
    assert not extra, f"{relative(path)} imports {sorted(extra)}; {part} may import {sorted(ALLOWED[part])}"


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_module_is_short_and_says_what_it_is_for(path):
    text = path.read_text()
    assert len(text.splitlines()) <= MAX_LINES
    docstring = ast.get_docstring(ast.parse(text))
    assert docstring, f"{relative(path)} has no docstring"
    assert docstring.splitlines()[0].endswith("."), f"{relative(path)}: the first line is a sentence"


def test_modules_form_no_import_cycle():
    names = {
        path: ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in MODULES
    }
    known = set(names.values())
    edges = {}
    for path, name in names.items():
        targets = set()
        for node in ast.parse(
            path.read_text()
        ).body:  # imports at the top only: those inside functions run later
            if isinstance(node, ast.ImportFrom) and node.module in known:
                targets |= {
                    f"{node.module}.{a.name}" if f"{node.module}.{a.name}" in known else node.module
                    for a in node.names
                }
            elif isinstance(node, ast.Import):
                targets |= {a.name for a in node.names if a.name in known}
        edges[name] = targets - {name}
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, f"cycle: {' -> '.join([*trail[trail.index(name) :], name])}"
        if name not in done:
            for target in edges[name]:
                visit(target, (*trail, name))
            done.add(name)

    for name in edges:
        visit(name, ())


def test_no_test_imports_a_test_file():
    """What tests share stands in a module of its own."""
    for path in TESTS:
        for node in ast.walk(ast.parse(path.read_text())):
            module = getattr(node, "module", None) or ""
            assert "test_" not in module, f"{relative(path)} imports {module}"


PARTS = re.compile(r"(_?\d+|_(one|two|three|a|b|more|part|rest|continued))$")


def test_no_file_is_a_numbered_part_of_another():
    """A file that would pass the cap is divided by purpose."""
    for path in [*MODULES, *TESTS]:
        whole = PARTS.sub("", path.stem)
        assert whole == path.stem or not (path.parent / f"{whole}.py").exists(), relative(path)


def test_picture_of_the_imports_is_that_of_the_code():
    assert picture() in MARKS.read(PAGE), "run: python -m tests.imports"


def test_page_names_only_files_that_there_are_and_all_that_branch_on_the_kind_of_law():
    page, files = PAGE.read_text(), [relative(path) for path in [*MODULES, *TESTS]]
    named = [name for name in re.findall(r"`([\w/]+\.py)`", page) if "NAME" not in name]
    assert [name for name in named if not any(f"/{file}".endswith(f"/{name}") for file in files)] == []
    branches = re.compile(r"isinstance\([^)]*\b(Cone|Radial)\b|[!=]= CONE\b")
    branching = [str(path.relative_to(PACKAGE)) for path in MODULES if branches.search(path.read_text())]
    assert [name for name in branching if name not in named] == []


def test_every_compiled_function_goes_through_jit():
    raw = [path for path in MODULES if path.parent.name != "jit" and "njit" in path.read_text()]
    assert raw == []


def test_commands_print_through_the_console_and_echo_that_escape():
    """A ``click.echo``, a ``print`` or a console of rich would pass control characters on."""
    raw = re.compile(
        r"click\.s?echo|(?<![\w.])print\(|rich\.console import .*\bConsole\b|sys\.std(out|err)\.write"
    )
    doors = {"cli/console.py", "cli/output.py"}
    for path in MODULES:
        name = path.relative_to(PACKAGE).as_posix()
        if name not in doors and path.relative_to(PACKAGE).parts[0] in ("cli", "view"):
            assert not raw.search(path.read_text()), name


def named_tests(module: Path) -> list[Path]:
    """Test files of a module: of its name, or its name and what of it they test."""
    folder = ROOT / "tests" / module.relative_to(PACKAGE).parent
    return [*folder.glob(f"test_{module.stem}.py"), *folder.glob(f"test_{module.stem}_*.py")]


def test_every_module_has_a_test_of_its_name_or_says_where_it_is_tested():
    covered = {name for names in TESTED_BY.values() for name in names.split()}
    modules = {path.relative_to(PACKAGE).with_suffix("").as_posix(): path for path in MODULES}
    untested = {
        name
        for name, path in modules.items()
        if path.stem != "__init__" and name not in covered and not named_tests(path)
    }
    assert not untested, "add a test file of that name under tests/, or name another one in TESTED_BY"
    assert all((ROOT / "tests" / test).exists() for test in TESTED_BY)
    assert covered <= set(modules), "TESTED_BY names modules that are gone"


WHITE_BOX = {
    "tests/estimate/test_estimator_resources.py",
    "tests/estimate/tracking/track_rig.py",
    "tests/hard/bits.py",
    "tests/hard/test_catalogue.py",
    "tests/hard/test_long_runs.py",
}
"""What compares, fills or steps the buffers of compiled kernels, which no caller ever sees."""
PUBLIC = {"_replace", "_asdict", "_fields", "_make", "_getframe", "_exit"}  # of named tuples, sys and os


def test_tests_use_no_private_attributes():
    """But of their own classes: what stands behind ``self`` or ``cls``."""
    for path in TESTS:
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.Attribute) or not re.match("_[a-z]", node.attr):
                continue
            owner = getattr(node.value, "id", "")
            is_public = owner in ("self", "cls") or node.attr in PUBLIC
            assert is_public or relative(path) in WHITE_BOX, f"{relative(path)}:{node.lineno}: {node.attr}"


MIRRORED = [
    path
    for path in TESTS
    if path.name.startswith("test_") and (PACKAGE / path.relative_to(ROOT / "tests").parent).is_dir()
]


def test_every_test_file_is_named_after_a_module_or_its_folder():
    for path in MIRRORED:
        folder = PACKAGE / path.relative_to(ROOT / "tests").parent
        subjects = {folder.name, *(module.stem for module in folder.glob("*.py"))} - {"__init__"}
        words = path.stem.removeprefix("test_").split("_")
        names = {"_".join(words[:n]) for n in range(1, len(words) + 1)}
        assert path.parent == ROOT / "tests" or names & subjects, (
            f"{relative(path)}: wanted one of {subjects}"
        )
