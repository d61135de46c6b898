"""Every number and name the code knows of is in the EDS files: looked up, not typed twice."""

import pytest

from skinbus.objects import cia, profile
from skinbus.objects.eds import load_eds

PATCHES = ["skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd", "skin-patch-fd32"]


OF_MODULES = {"PROCESS_VALUE_16"}
"""What analogue modules of other makers have, which can be boards."""


def indices():
    """Return the index constants of cia.py: those of 0x1000 and more that stand for objects of ours."""
    return {
        name: value
        for name, value in vars(cia).items()
        if name.isupper() and isinstance(value, int) and 0x1000 <= value <= 0xFFFF and name not in OF_MODULES
    }


@pytest.mark.parametrize(("name", "index"), indices().items())
def test_every_index_is_in_one_of_our_files(name, index):
    assert any(index in load_eds(eds, 1) for eds in [*PATCHES, "skin-master"]), name


@pytest.mark.slow
def test_every_name_is_in_the_files_of_all_patches_or_of_the_master():
    names = [name for key, name in vars(profile).items() if key.isupper() and isinstance(name, str)]
    optional = {profile.FRAME_BYTES}
    for name in names:
        in_file = []
        for eds in [*PATCHES, "skin-master"]:
            try:
                in_file.append(profile.index_of(load_eds(eds, 1), name)[0] in range(0x2000, 0x6000))
            except KeyError:
                in_file.append(False)
        assert in_file[-1] or all(in_file[:-1]) or name in optional, name


def test_an_abort_code_says_what_it_means():
    assert cia.describe_abort(0x06090011) == "0x06090011 (Subindex does not exist)"
    assert "unknown" in cia.describe_abort(0x12345678)


"""Masks of identifiers, and the default of an option."""
