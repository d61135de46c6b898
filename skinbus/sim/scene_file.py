"""Scene files: TOML to a Scene, with every fault of the file reported at once."""

from __future__ import annotations

import os
from dataclasses import MISSING
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from skinbus.config.parameters import read, read_rest
from skinbus.config.system import load_arm
from skinbus.config.toml_file import find_toml, names_in, read_toml
from skinbus.config.wording import nearest
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.model import Arm
from skinbus.sim.default_scene import default_scene
from skinbus.sim.effect import Effect, parameter, settings
from skinbus.sim.effects import ORDER, effect_class
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import LAWS, Elastic, LayerSettings
from skinbus.sim.scene import Scene
from skinbus.sim.touch import Touch
from skinbus.sim.touch_table import TouchTable, touch_of

if TYPE_CHECKING:
    from skinbus.sim.joint_motion import JointMotion

SCENES: Final = Path(__file__).parent / "scenes"
"""The scenes that travel with the package."""

_PLACE: Final = frozenset({"s_mm", "angle_deg", "a_mm", "xyz_mm", "path"})
_TABLES: Final = ("scene", "layer", "joint", "touch", "effect")


@settings
class SceneTable:
    """[scene]: what happens to which arm, and for how long."""

    arm: str
    duration_s: float = parameter(MISSING, "s", "length of the scene", gt=0, le=1e6)
    seed: int = parameter(0, "", "of all random draws", ge=0, lt=2**63)
    title: str = parameter("", "", "what the scene shows, in one line")


class _ReadTouch(NamedTuple):
    """A [[touch]] as far as it can be read: None where nothing of it can, and the names that are faulty."""

    key: str
    table: TouchTable | None
    faulty: frozenset[str]
    faults: list[Fault]


def scene_names() -> list[str]:
    """Return the names of the scenes that travel with the package."""
    return list(names_in(SCENES))


def load_scene(name_or_path: str | Path, *, arm: Arm | None = None) -> Scene:
    """Return the scene of a file, or one that travels with the package, by name.

    Args:
        name_or_path: a path, or one of :func:`scene_names`; spaces in a name are as good as hyphens. An arm
            file stands for its default scene.
        arm: take this arm instead of the one the file names.

    Raises:
        ConfigError: every fault of the file: key, value seen, value wanted.
    """
    path = find_toml(name_or_path, SCENES, "scene")
    document = read_toml(path)
    if "arm" in document and "scene" not in document:  # an arm file: its default scene
        arm = arm or load_arm(path)
        document = default_scene(arm)
    return scene_of(document, file=str(name_or_path), name=path.stem, folder=path.parent, arm=arm)


def scene_of(
    document: dict[str, Any],
    *,
    file: str = "scene",
    name: str = "scene",
    folder: Path | None = None,
    arm: Arm | None = None,
) -> Scene:
    """Return the scene of a TOML document that was read from ``file`` in ``folder``.

    Raises:
        ConfigError: every fault of the document.
    """
    faults = FaultList(
        Fault(key, None, f"no such table; known are {', '.join(_TABLES)}{nearest(key, _TABLES)}")
        for key in document
        if key not in _TABLES
    )
    stand_ins = {"arm": "", "duration_s": 1.0}
    head, faulty = read_rest(SceneTable, document.get("scene", {}), "scene", faults, stand_ins)
    if arm is None:
        arm = _arm(document, folder, faults)
    layer = _layer(document.get("layer", {}), faults)
    motion = _motion(document.get("joint", []), arm, faults)
    duration_s = None if head is None or "duration_s" in faulty else head.duration_s
    tables = _touch_tables(document.get("touch", []), arm, faults)
    touches = _touches(tables, arm, motion, duration_s, faults)
    effects = _effects(document.get("effect", {}), arm, faults)
    faults += _law_faults(document.get("layer", {}), [read.table for read in tables if read.table], document)
    if faults or head is None or arm is None or layer is None:
        raise ConfigError(file, faults)
    return Scene(
        name,
        arm,
        duration_s=head.duration_s,
        seed=head.seed,
        title=head.title,
        layer=layer,
        touches=touches,
        effects=effects,
        motion=motion,
    )


def _arm(document: dict[str, Any], folder: Path | None, faults: list[Fault]) -> Arm | None:
    table = document.get("scene")
    name = table.get("arm") if isinstance(table, dict) else None
    if not isinstance(name, str):
        return None  # said by the schema already
    beside = folder / name if folder is not None else Path(name)
    try:
        return load_arm(beside if os.path.isfile(beside) else name)
    except ConfigError as error:
        faults.extend(Fault(f"scene.arm ({error.file}) {f.key}", f.seen, f.wanted) for f in error.faults)
        return None


def _layer(table: Any, faults: list[Fault]) -> LayerSettings | None:
    if not isinstance(table, dict):
        faults.append(Fault("layer", table, "a table"))
        return None
    settings = dict(table)
    law = settings.pop("law", Elastic.law)
    if law not in LAWS:
        faults.append(Fault("layer.law", law, f"one of {', '.join(LAWS)}"))
        return None
    layer = read(LAWS[law], settings, "layer", faults)
    if isinstance(layer, Elastic) and layer.depth_mm is not None and layer.depth_mm > layer.thickness_mm:
        faults.append(
            Fault("layer.depth_mm", layer.depth_mm, f"at most the thickness, {layer.thickness_mm} mm")
        )
    return layer


def _law_faults(layer: Any, touches: list[TouchTable], document: dict[str, Any]) -> list[Fault]:
    """Return what a scene asks of a law that does not have it, and inclined touches without shear."""
    law = layer.get("law", Elastic.law) if isinstance(layer, dict) else None
    effects = document.get("effect", {})
    names = {*effects} if isinstance(effects, dict) else {"shear"}
    faults = []
    if law in LAWS and law != Elastic.law:
        wanted = f"layer law {Elastic.law!r}: the {law} is the law of a push in one place"
        shapes = sorted({touch.shape for touch in touches} & {"edge", "palm", "sphere"})
        faults += [Fault("touch.shape", shape, wanted) for shape in shapes]
        faults += [Fault(f"effect.{name}", None, wanted) for name in sorted(names & {"shear", "response"})]
    if "shear" not in names and any(touch.inclination for touch in touches):
        faults.append(Fault("touch.inclination", None, "the effect shear, which lets it act"))
    extended = [t for t in touches if t.inclination and not Shape[t.shape.upper()].is_round]
    faults += [Fault("touch.inclination", t.inclination, "0 of an edge or a palm") for t in extended]
    return faults


def _motion(tables: Any, arm: Arm | None, faults: list[Fault]) -> JointMotion | None:
    """Return how joints move; nothing of robots is loaded for a scene without such tables."""
    if not isinstance(tables, list):
        faults.append(Fault("joint", tables, "an array of tables, [[joint]]"))
        return None
    if arm is None or not tables:
        return None
    from skinbus.sim.joint_motion import JointPathTable, motion_of

    keyed = [(f"joint {i}", table) for i, table in enumerate(tables, 1)]
    parsed = [(key, read(JointPathTable, table, key, faults)) for key, table in keyed]
    return motion_of([(key, table) for key, table in parsed if table is not None], arm, faults)


def _touch_tables(tables: Any, arm: Arm | None, faults: list[Fault]) -> list[_ReadTouch]:
    """Return the tables of touches as far as they can be read."""
    if not isinstance(tables, list):
        faults.append(Fault("touch", tables, "an array of tables, [[touch]]"))
        return []
    stand_ins = {"link": arm.links[0].name if arm else "", "force_n": 1.0}
    found = []
    for i, table in enumerate(tables, 1):
        own: list[Fault] = []
        parsed, faulty = read_rest(TouchTable, table, f"touch {i}", own, stand_ins)
        found.append(_ReadTouch(f"touch {i}", parsed, faulty, own))
    return found


def _touches(
    tables: list[_ReadTouch],
    arm: Arm | None,
    motion: JointMotion | None,
    duration_s: float | None,
    faults: list[Fault],
) -> list[Touch]:
    touches = []
    for key, table, faulty, own in tables:
        faults.extend(own)
        if table is None:
            continue
        more: list[Fault] = []
        touch = touch_of(table, key, arm, duration_s, more)
        if touch is not None and table.fixed_in == "base" and not faulty:
            touch = _in_base(touch, key, motion, more)
        if touch is not None and not faulty:
            touches.append(touch)
        # nothing is said of what stands in for a faulty value, or of a place that lacks one
        unknown = faulty | (_PLACE if faulty & {*_PLACE, "link"} else frozenset())
        faults.extend(fault for fault in more if fault.key.removeprefix(f"{key}.") not in unknown)
    return touches


def _in_base(touch: Touch, key: str, motion: JointMotion | None, faults: list[Fault]) -> Touch | None:
    if motion is None:
        faults.append(Fault(f"{key}.fixed_in", "base", "[robot] in the arm file and [[joint]] in the scene"))
        return None
    try:
        return motion.in_base(touch)
    except ValueError as error:
        faults.append(Fault(f"{key}.fixed_in", "base", str(error)))
        return None


def _effects(tables: Any, arm: Arm | None, faults: list[Fault]) -> list[Effect]:
    if not isinstance(tables, dict):
        faults.append(Fault("effect", tables, "a table of tables, [effect.NAME]"))
        return []
    effects: list[Effect] = []
    for name, table in tables.items():
        if name not in ORDER:
            hint = nearest(name, list(ORDER))
            faults.append(Fault(f"effect.{name}", None, f"an effect; known are {', '.join(ORDER)}{hint}"))
            continue
        effect, faulty = read_rest(effect_class(name), table, f"effect.{name}", faults, {})
        if effect is not None:
            own = [] if arm is None else effect.check(arm)
            faults.extend(
                Fault(f"effect.{name}.{f.key}", f.seen, f.wanted) for f in own if f.key not in faulty
            )
            effects.append(effect)
    return effects
