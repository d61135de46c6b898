"""The EDS files of our boards are one family: only what is listed here differs between them."""

from functools import cache
from itertools import combinations

import pytest
from canopen.objectdictionary import ODVariable

from skinbus.objects import cia, profile
from skinbus.objects.eds import eds_names, load_eds

BOARDS = [name for name in eds_names() if name.startswith("skin-patch")]
PAIRS = list(combinations(BOARDS, 2))


def places(*names):
    """Index and sub-index of our objects, as all boards have them."""
    return {profile.index_of(load_eds("skin-patch", 1), name) for name in names}


LAYOUT = places(profile.TACTEL_COUNT, profile.WIDTH_UM, profile.HEIGHT_UM, profile.TACTEL_DIAMETER_UM)
POSITIONS = {index for index, _ in places(profile.TACTEL_U_UM, profile.TACTEL_V_UM)}
LEARNED = places(profile.RADIAL_STEP_UM, profile.LAW_MISFIT)
RADIAL = {index for index, _ in places(profile.RADIAL_LAW, profile.MISFIT_PROFILE)}
OF_CONVERTER = places(
    profile.FULL_SCALE_PA,
    profile.TRANSDUCER_BITS,
    profile.TOUCH_PA,
    profile.RELEASE_PA,
    profile.NOISE_PA,
    profile.ZERO_BAND_PA,
    profile.ZERO_DRIFT_PA,
)
HEALTHY = places(profile.HEALTHY_TACTELS)
NAME = {(cia.DEVICE_NAME, 0), (cia.IDENTITY, cia.IDENTITY_PRODUCT)}


@cache
def entries(board):
    """Every variable of a board by index and sub-index."""
    od = load_eds(board, 1)
    found = {}
    for index in od:
        item = od[index]
        for variable in [item] if isinstance(item, ODVariable) else item.values():
            found[index, variable.subindex] = variable
    return found


def description(variable):
    """All of it but the default."""
    v = variable
    return v.name, v.data_type, v.access_type, v.min, v.max, v.pdo_mappable, v.relative


def may_differ(key):
    """Whether boards may have different defaults here."""
    index, sub = key
    return (
        key in LAYOUT | OF_CONVERTER | HEALTHY | LEARNED | NAME
        or index in POSITIONS | RADIAL
        or index in range(cia.TPDO_MAPPING, 0x1C00)
        or (
            sub == 0 and index >= 0x2000 and any((index, 2) in entries(board) for board in BOARDS)
        )  # the length of an array
    )


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_what_two_boards_share_is_described_alike(one, other):
    a, b = entries(one), entries(other)
    counts = {(index, 0) for index in range(cia.TPDO_MAPPING, 0x1C00)}  # one has more entries
    different = [k for k in a.keys() & b.keys() - counts if description(a[k]) != description(b[k])]
    assert different == []


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_defaults_differ_only_where_boards_do(one, other):
    a, b = entries(one), entries(other)
    different = [k for k in a.keys() & b.keys() if a[k].default != b[k].default and not may_differ(k)]
    assert sorted(different) == []
