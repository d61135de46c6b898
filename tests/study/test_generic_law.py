"""The law that boards ship with: what the EDS files hold is what the command makes of them."""

import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from skinbus.cli.commands.study import command
from skinbus.errors import ConfigError
from skinbus.model import Radial
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import find_eds, load_eds
from skinbus.study.generic_law import generic_law, write_generic_law

BOARDS = ["skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd", "skin-patch-fd32"]


@pytest.mark.slow
@pytest.mark.parametrize("name", BOARDS)
def test_shipped_law_is_the_one_that_is_learned(name):
    patch = describe_patch(load_eds(name, 1))
    learned = generic_law(patch)
    assert isinstance(patch.law, Radial)
    d = np.linspace(0.0, 0.03, 61)
    # the step is stored in whole micrometres, the table in 32 bits
    assert np.abs(patch.law.profile(d) - learned.profile(d)).max() <= 1e-3 * learned.table[0]
    # A hundredth: how rounding is weighed moves it by two thousandths on boards of 8 bits.
    assert patch.law.misfit == pytest.approx(learned.misfit, rel=1e-2)
    assert patch.law.exponent == 1.0


def test_boards_with_one_layout_have_one_law():
    one, other = (describe_patch(load_eds(name, 1)).law for name in BOARDS[:2])
    assert (one.step, one.misfit) == (other.step, other.misfit)
    assert (one.table == other.table).all()


def test_command_writes_defaults_and_nothing_else(tmp_path):
    file = tmp_path / "board.eds"
    shutil.copy(find_eds("skin-patch"), file)
    shipped = file.read_text()
    kind = "[2020sub1]"
    head, rest = shipped.split(kind, 1)
    spoilt = head + kind + rest.replace("DefaultValue=1", "DefaultValue=0", 1)
    assert spoilt != shipped
    file.write_text(spoilt)
    result = CliRunner().invoke(command, ["law", str(file)])
    assert result.exit_code == 0, result.output
    assert "misfit" in result.output
    changed = [
        line
        for line, was in zip(file.read_text().split("\n"), shipped.split("\n"), strict=True)
        if line != was
    ]
    # other machines may differ in the last bits of a real number
    assert all(line.startswith("DefaultValue=0x") for line in changed)


def test_file_without_a_place_for_the_law_is_refused(tmp_path):
    file = tmp_path / "board.eds"
    text = find_eds("skin-patch").read_text()
    head, rest = text.split("[2021sub7]", 1)
    section, tail = rest.split("[2021sub8]", 1)
    file.write_text(
        head + "[2021sub7]" + section.replace("DefaultValue=", "defaultvalue = ") + "[2021sub8]" + tail
    )
    with pytest.raises(ConfigError, match="2021sub7"):
        write_generic_law(file)
