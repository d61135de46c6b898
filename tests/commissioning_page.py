"""What the commands of docs/commissioning.md print, on simulated boards.

``python -m tests.commissioning_page`` writes it into the page, and a test holds the page to it.
"""

import os
import tempfile
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
from tests.estimate.located_boards import misplaced, plan, pressed
from tests.master.commissioning.story import Story
from tests.master.watched import Watched

PAGE = Path(__file__).parents[1] / "docs" / "commissioning.md"
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


def outputs():
    """What stands between the marks, by name."""
    with tempfile.TemporaryDirectory() as where:
        folder = Path(where)
        made = {"identify": identified(), "locate": located(folder), "health": healthy(folder)}
    return {name: "```text\n" + text.strip("\n") + "\n```" for name, text in made.items()}


if __name__ == "__main__":
    os.environ["COLUMNS"] = "100"
    for name, text in outputs().items():
        marks(name).write(PAGE, text)
