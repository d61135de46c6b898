"""The architecture as tests: allowed imports, no cycles, one door for compiled code and for printing."""

import ast
import re
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "skinbus"
MODULES = sorted(PACKAGE.rglob("*.py"))

ALLOWED = {
    "can": "",
    "model": "",
    "objects": "can model",
    "config": "model objects robot",
    "estimate": "model",
    "robot": "model",
    "node": "can model objects",
    "bus": "can",
    "firmware": "objects node",
    "sim": "can model objects config node robot",
    "master": "can model objects config node estimate robot",
    "planning": "can model objects config estimate",
    "study": "can model objects config node estimate robot sim master planning",
    "skin": "can model objects config node estimate robot bus sim master planning",
    "view": "can model objects config robot skin",
    "gateway": "can model objects config node",
    "guard": "can model objects config node",
}
FREE = {
    "arrays.py",
    "cli",
    "__init__.py",
    "__main__.py",
    "errors.py",
    "file_bytes.py",
    "formatting.py",
    "jit",
    "lazy.py",
    "printable.py",
}  # all parts, or none by their nature
EVERYONE_MAY = {"arrays", "file_bytes", "errors", "formatting", "jit", "lazy", "printable"}


def imported_parts(path):
    """Names of the parts of skinbus that a module imports, at any depth of its code."""
    parts = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            names = [module]
            if module == "skinbus":  # its own names (__version__) are everyone's
                names = [f"skinbus.{alias.name}" for alias in node.names if not alias.name.startswith("__")]
        parts |= {name.split(".")[1] for name in names if name.startswith("skinbus.")}
    return parts


def relative(path):
    return str(path.relative_to(ROOT))


@pytest.mark.parametrize("path", MODULES, ids=relative)
def test_module_imports_only_what_the_design_allows(path):
    part = path.relative_to(PACKAGE).parts[0]
    if part in FREE:
        return
    extra = imported_parts(path) - {*ALLOWED[part].split()} - EVERYONE_MAY - {part}
    assert not extra, f"{relative(path)} imports {sorted(extra)}; {part} may import {ALLOWED[part]}"


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
    TopologicalSorter(edges).prepare()  # its CycleError names the modules


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
