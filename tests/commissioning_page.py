"""What the commands of docs/commissioning.md and docs/calibration.md print, on simulated boards.

``python -m tests.commissioning_page`` writes it into the pages, and a test holds them to it.
"""

import os
import tempfile
from contextlib import chdir
from dataclasses import replace
from pathlib import Path

import numpy as np
from click.testing import CliRunner

from skinbus.cli import group
from skinbus.cli.health_keeper import health_file
from skinbus.config.system import load_arm
from skinbus.master.health import SETTLED
from skinbus.study.marked import Marks
from tests.cli.commands.press_table import write_presses
from tests.cli.commands.pressed_field import make_field
from tests.cli.simulated_presses import main as write_simulated
from tests.estimate.located_boards import misplaced, plan, pressed
from tests.master.commissioning.press_bench import Bench
from tests.master.commissioning.story import Story
from tests.master.watched import Watched

DOCS = Path(__file__).parents[1] / "docs"
SEED = 7


def marks(name):
    return Marks(f"<!-- {name}: made by python -m tests.commissioning_page -->", f"<!-- /{name} -->")


def run(*args):
    result = CliRunner(env={"COLUMNS": "100", "TERM": "dumb"}).invoke(group, [str(arg) for arg in args])
    assert not isinstance(result.exception, Exception), result.exception
    return result.output


def identified():
    """The first two places of a dialogue, one press of which is wrong."""
    story = Story(seed=SEED)
    lines = list(story.lines)
    while not story.dialogue.found:
        lines += story.obey()
    lines += story.press(story.person.point(0))  # the same board again
    lines += story.obey()
    return "\n".join(lines)


def located(folder):
    """Four boards, six presses each, one of them at a wrong place."""
    path = plan(folder, "cylinder", n=4)
    planned = load_arm(path)
    presses = pressed(misplaced(planned, np.random.default_rng(SEED)), SEED)
    presses[8] = replace(presses[8], s=presses[8].s + 9e-3)
    write_presses(folder / "presses.csv", presses, planned)
    return run("locate", path, "--presses", folder / "presses.csv")


def healthy(folder):
    """A board of which one tactel has become noisy."""
    watched = Watched(SEED)
    watched.run(10 * SETTLED + 30)
    watched.noise = np.where(np.arange(16) == 6, 900.0, 200.0)
    watched.run(300)
    health_file(folder / "my-arm.state").save(watched.tables())
    return run("health", "pad", "--state", folder / "my-arm.state")


def joined(folder):
    """Four presses in a recording."""
    make_field(folder, 4, SEED)
    files = ["--poses", "robot.csv", "--force", "force.csv", "--out", "field.csv"]
    return run("presses", "field.log", "--arm", "pad", *files)


def calibrated():
    """A board of which one tactel reads too little and one is noisy, three presses elsewhere than said."""
    write_simulated("presses.csv")
    return run("calibrate", "pad", "presses.csv", "--out", "boards.dcf")


def live():
    """The first presses of a dialogue, one of which is elsewhere."""
    bench = Bench(SEED)
    bench.obey()
    s, a = bench.asked()
    bench.press(s + 15e-3, a)
    bench.obey()
    return "\n".join(bench.lines)


def outputs():
    """What stands between the marks: by page and name."""
    with tempfile.TemporaryDirectory() as where, chdir(where):
        folder = Path(where)
        made = {
            ("commissioning.md", "identify"): identified(),
            ("commissioning.md", "locate"): located(folder),
            ("commissioning.md", "presses"): joined(folder),
            ("commissioning.md", "calibrate"): calibrated(),
            ("commissioning.md", "health"): healthy(folder),
            ("calibration.md", "live"): live(),
        }
    return {key: "```text\n" + text.strip("\n") + "\n```" for key, text in made.items()}


if __name__ == "__main__":
    os.environ["COLUMNS"] = "100"
    for (page, name), text in outputs().items():
        marks(name).write(DOCS / page, text)
