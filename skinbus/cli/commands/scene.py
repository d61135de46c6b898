"""`skinbus scene`: what scenes can name, whether a file is right, and what it costs."""

from __future__ import annotations

import time
from dataclasses import Field, fields
from typing import Any

import click

from skinbus.cli.console import Console
from skinbus.cli.output import echo
from skinbus.config.wording import nearest
from skinbus.formatting import counted
from skinbus.robot.chain import check_robot
from skinbus.sim import load_scene, scene_names
from skinbus.sim.cost import measure
from skinbus.sim.effect import ORDER
from skinbus.sim.effects import effect_class
from skinbus.sim.laws import LAWS


@click.group()
def command() -> None:
    """List, check and price scenes.

    \b
    Examples:
      skinbus scene list
      skinbus scene list noise drift
      skinbus scene check my-scene.toml
      skinbus scene cost everything
    """


@command.command("list")
@click.argument("names", nargs=-1)
def list_(names: tuple[str, ...]) -> None:
    """List scenes, layers and effects.

    One line each; with NAMES, their parameters and defaults.

    \b
    Examples:
      skinbus scene list
      skinbus scene list noise drift
    """
    console = Console()
    effects = [effect_class(name) for name in ORDER]
    items: list[tuple[str, str, Any]] = [(name, "law", cls) for name, cls in sorted(LAWS.items())]
    items += [(cls.name, cls.stage.name.lower(), cls) for cls in effects]
    known = [name for name, _, _ in items]
    if unknown := [f"{name}{nearest(name, known)}" for name in names if name not in known]:
        raise click.BadParameter(f"no effect or layer: {', '.join(unknown)}", param_hint="NAMES")
    for name, stage, cls in items:
        if name in names:
            rows = [(one.name, _shown(one), one.metadata["description"]) for one in fields(cls)]
            console.table(("parameter", "default", "what"), rows, f"\n{name} ({stage}): {_about(cls)}")
    if not names:
        scenes = [(name, load_scene(name).title) for name in scene_names()]
        console.table(("scene", "what it shows"), scenes)
        parts = [(name, stage, _about(cls)) for name, stage, cls in items]
        console.table(("name", "acts on", "what"), parts, "\nLayers and effects, in the order of physics")


@command.command()
@click.argument("file")
def check(file: str) -> None:
    """Check the scene FILE (or a scene's name).

    For an arm file the scene is a fingertip that presses some boards, one after the other.

    \b
    Examples:
      skinbus scene check my-scene.toml
    """
    scene = load_scene(file)
    check_robot(scene.arm)
    names = ", ".join(effect.name for effect in scene.effects) or "no effects"
    echo(
        f"{file}: no faults; {counted(scene.arm.n_patches, 'patch')} of {scene.arm.name}, "
        f"{counted(len(scene.touches), 'touch')}, {scene.duration_s:g} s, {scene.layer.law} layer, {names}"
    )


@command.command()
@click.argument("scene")
def cost(scene: str) -> None:
    """Measure what each part of SCENE costs per cycle.

    A part is left out, and the rest is timed.

    Times are processor times; a scene with every effect takes about a minute.

    \b
    Examples:
      skinbus scene cost everything
    """
    played = load_scene(scene)
    console = Console()
    with console.status("playing ..."):
        result = measure(played, time.thread_time_ns)
    parts = {**result.parts, "whole": result.whole_us}
    rows = [(name, f"{us:.1f}", f"{100 * us / result.whole_us:.1f}") for name, us in parts.items()]
    console.table(("part", "us", "%"), rows, f"{played.name}: cost of a cycle")


def _about(cls: type) -> str:
    return str(cls.__doc__).splitlines()[0]


def _shown(one: Field[Any]) -> str:
    if one.default is None:
        return "not given"
    value = f"{one.default:g}" if isinstance(one.default, float) else str(one.default)
    return f"{value} {one.metadata['title']}".strip()
