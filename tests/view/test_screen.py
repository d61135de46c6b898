"""The screen of a running master fits the terminal; every tactel has its place in the picture."""

import io

import pytest

from skinbus.cli.console import Console
from skinbus.config.system import load_arm
from skinbus.skin.master_cycles import CycleMaker
from skinbus.view.screen import Screen
from skinbus.view.unrolled import CONTACT_STYLE, LOST, Unrolled
from tests.master.rig import Rig


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["pad", "forearm", "arm"])
def test_screen_fits_the_terminal(scene):
    rig = Rig(scene)
    (lost,) = rig.scene.arm.node_id[-1:].tolist()
    rig.run(2000)
    rig.patches.unplugged = {lost}
    report = rig.run(100)[0][-1]
    cycle = CycleMaker(rig.scene.arm).make(rig.master, report)
    for width, height in ((80, 24), (200, 60)):
        file = io.StringIO()
        console = Console(file=file, width=width, height=height, force_terminal=False)
        console.print(Screen(rig.scene.arm).render(cycle, width, height))
        lines = file.getvalue().splitlines()
        assert len(lines) < height
        assert max(map(len, lines)) <= width
        assert "..." not in file.getvalue()
        ids = {int(line.split()[0]) for line in lines if " held " in line or " touch " in line}
        assert ids >= set(report.ids.tolist()) - {0}
        is_crossed_out = sum(line.count(LOST) for line in lines[1:]) >= 8
        assert is_crossed_out or f"lost boards: {lost}" in file.getvalue()


@pytest.mark.parametrize("name", ["pad", "forearm"])
def test_every_tactel_has_a_character_at_80_columns(name):
    arm = load_arm(name)
    unrolled = Unrolled(arm, 80)
    assert unrolled.size[0] <= 80
    zeros = [0.0] * arm.n_tactels
    for t in range(0, arm.n_tactels, 7):
        lost = [k == t for k in range(arm.n_tactels)]
        assert LOST in unrolled.render(zeros, 1.0, lost=lost).plain


def test_ids_are_whole():
    picture = Unrolled(load_arm("forearm"), 80).render([0.0] * 384, 1.0, [(0, 0.076, 0.2, "127")])
    assert "127" in picture.plain
    assert any(span.style == CONTACT_STYLE for span in picture.spans)
