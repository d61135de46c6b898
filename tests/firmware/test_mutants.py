"""The check of a board is judged by faults that real firmware has: each is named, or it is said why not."""

import pytest

from tests.firmware.mutants import SensingFirmware, Workshop, broken_rules, load_mutants

MUTANTS = list(load_mutants())


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    return Workshop(tmp_path_factory.mktemp("mutants"))


@pytest.mark.slow
@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.name)
def test_check_of_a_board_names_the_fault(workshop, mutant):
    device = SensingFirmware(workshop.make(mutant))
    found = broken_rules(device, n_syncs=2000 if "rare" in mutant.name else 100, ask=device.press)
    assert bool(found) != bool(mutant.reason), found
