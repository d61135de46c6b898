"""The screen of a running master fits the terminal, and has its contacts and lost boards."""

import io

import pytest

from skinbus.cli.console import Console
from skinbus.skin.master_cycles import CycleMaker
from skinbus.view.screen import Screen
from skinbus.view.unrolled import LOST
from tests.marks import slow
from tests.master.rig import Rig


@pytest.mark.parametrize("scene", ["pad", *slow("arm")])
def test_screen_fits_the_terminal(scene):
    rig = Rig(scene)
    (lost,) = rig.scene.arm.node_id[-1:].tolist()
    rig.run(800)
    rig.patches.unplugged = {lost}
    report = rig.run(100)[0][-1]
    cycle = CycleMaker(rig.scene.arm).make(rig.master, report)
    for width, height in ((80, 24), (200, 60)):
        file = io.StringIO()
        Console(file=file, width=width, height=height).print(
            Screen(rig.scene.arm).render(cycle, width, height)
        )
        lines = file.getvalue().splitlines()
        assert len(lines) < height
        assert max(map(len, lines)) <= width
        ids = {int(line.split()[0]) for line in lines if " held " in line or " touch " in line}
        assert ids >= set(report.ids.tolist()) - {0}
        assert f"lost boards: {lost}" in file.getvalue() or sum(line.count(LOST) for line in lines) >= 8
