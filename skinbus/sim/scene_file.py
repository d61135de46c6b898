"""Scene files: TOML to a Scene, with every fault of the file reported at once."""

from __future__ import annotations

import os
from dataclasses import MISSING
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from skinbus.config.parameters import read
from skinbus.config.system import load_arm
from skinbus.config.toml_file import find_toml, names_in, read_toml
from skinbus.config.wording import nearest
from skinbus.errors import ConfigError, Fault, FaultList
from skinbus.model import Arm
from skinbus.sim.default_scene import default_scene
from skinbus.sim.effect import ORDER, Effect, parameter, settings
from skinbus.sim.effects import effect_class
from skinbus.sim.indenter import Shape
from skinbus.sim.laws import LAWS, ConeSettings, Elastic, LayerSettings
from skinbus.sim.scene import Scene
from skinbus.sim.touch_table import TouchTable, touch_of

if TYPE_CHECKING:
    from skinbus.sim.joint_motion import JointMotion

SCENES = Path(__file__).parent / "scenes"
"""The scenes that travel with the package."""

T = TypeVar("T")

_TABLES = ("scene", "layer", "joint", "touch", "effect")


@settings
class SceneTable:
    """[scene]: what happens to which arm, and for how long."""

    arm: str
    duration_s: float = parameter(MISSING, "s", "length of the scene", gt=0, le=1e6)
    seed: int = parameter(0, "", "of all random draws", ge=0, lt=2**63)
    title: str = parameter("", "", "what the scene shows, in one line")


def scene_names() -> list[str]:
    """Return the names of the scenes that travel with the package."""
    return names_in(SCENES)


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
    head = read(SceneTable, document.get("scene", {}), "scene", faults)
    if arm is None:
        arm = _arm(document, folder, faults)
    layer = _layer(document.get("layer", {}), faults)
    motion = _motion(document.get("joint", []), arm, faults)
    tables = _read_each(TouchTable, "touch", document.get("touch", []), faults)
    duration_s = head.duration_s if head else None
    touches = [touch_of(table, key, arm, duration_s, faults) for key, table in tables]
    effects = _effects(document.get("effect", {}), arm, faults)
    _check_law(layer, [table for _, table in tables], document.get("effect", {}), faults)
    if faults or head is None or arm is None or layer is None:
        raise ConfigError(file, faults)
    return Scene(
        name,
        arm,
        duration_s=head.duration_s,
        seed=head.seed,
        title=head.title,
        layer=layer,
        touches=[touch for touch in touches if touch],
        effects=effects,
        motion=motion,
    )


def _arm(document: dict[str, Any], folder: Path | None, faults: FaultList) -> Arm | None:
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


def _layer(table: Any, faults: FaultList) -> LayerSettings | None:
    if not isinstance(table, dict):
        faults.add("layer", table, "a table")
        return None
    settings = dict(table)
    law = settings.pop("law", Elastic.law)
    if law not in LAWS:
        faults.add("layer.law", law, f"one of {', '.join(LAWS)}")
        return None
    return read(LAWS[law], settings, "layer", faults)


def _check_law(
    layer: LayerSettings | None, touches: list[TouchTable], effects: Any, faults: FaultList
) -> None:
    """Add what a scene asks of a law that does not have it, and inclined touches without shear."""
    names = {*effects} if isinstance(effects, dict) else {"shear"}
    if isinstance(layer, ConeSettings):
        wanted = f"layer law {Elastic.law!r}: the {layer.law} is the law of a push in one place"
        for shape in sorted({touch.shape for touch in touches} & {"edge", "palm", "sphere"}):
            faults.add("touch.shape", shape, wanted)
        for name in sorted(names & {"shear", "response"}):
            faults.add(f"effect.{name}", None, wanted)
    if "shear" not in names and any(touch.inclination for touch in touches):
        faults.add("touch.inclination", None, "the effect shear, which lets it act")
    for touch in touches:
        if touch.inclination and not Shape[touch.shape.upper()].is_round:
            faults.add("touch.inclination", touch.inclination, "0 of an edge or a palm")


def _read_each(cls: type[T], key: str, tables: Any, faults: FaultList) -> list[tuple[str, T]]:
    """Return the tables of an array that can be read, each with its key."""
    if not isinstance(tables, list):
        faults.add(key, tables, f"an array of tables, [[{key}]]")
        return []
    keyed = [(f"{key} {i}", table) for i, table in enumerate(tables, 1)]
    parsed = [(key, read(cls, table, key, faults)) for key, table in keyed]
    return [(key, table) for key, table in parsed if table is not None]


def _motion(tables: Any, arm: Arm | None, faults: FaultList) -> JointMotion | None:
    """Return how joints move; nothing of robots is loaded for a scene without such tables."""
    if tables == [] or arm is None:
        return None
    from skinbus.sim.joint_motion import JointPathTable, motion_of

    parsed = _read_each(JointPathTable, "joint", tables, faults)
    return motion_of(parsed, arm, faults) if parsed else None


def _effects(tables: Any, arm: Arm | None, faults: FaultList) -> list[Effect]:
    if not isinstance(tables, dict):
        faults.add("effect", tables, "a table of tables, [effect.NAME]")
        return []
    effects: list[Effect] = []
    for name, table in tables.items():
        if name not in ORDER:
            hint = nearest(name, list(ORDER))
            faults.add(f"effect.{name}", None, f"an effect; known are {', '.join(ORDER)}{hint}")
            continue
        effect = read(effect_class(name), table, f"effect.{name}", faults)
        if effect is not None:
            own = effect.check(arm) if arm is not None else ()
            faults += [Fault(f"effect.{name}.{fault.key}", fault.seen, fault.wanted) for fault in own]
            effects.append(effect)
    return effects
