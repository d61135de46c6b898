"""Where buses are: by the user, else by the arm file, else the usual channel; what does not fit is said."""

import pytest

from skinbus.config.system import load_arm
from skinbus.errors import AddressError
from skinbus.model import BusSettings
from skinbus.skin.addresses import bus_numbers, find_places, one_bus

ONE = (BusSettings(bitrate=500_000),)
TWO = (BusSettings(name="left", bitrate=500_000), BusSettings(name="right", channel="can7"))


@pytest.mark.parametrize(
    ("buses", "interface", "channels", "bitrate", "places"),
    [
        (ONE, None, (), None, [("socketcan", "can0", 500_000)]),
        (ONE, "udp_multicast", (), None, [("udp_multicast", "239.74.163.2", 500_000)]),
        (ONE, "slcan", ("/dev/a=b",), 125_000, [("slcan", "/dev/a=b", 125_000)]),
        (TWO, None, ("can3",), None, [("socketcan", "can3", 500_000), ("socketcan", "can7", 1_000_000)]),
        (TWO, None, ("a", "b"), None, [("socketcan", "a", 500_000), ("socketcan", "b", 1_000_000)]),
        (
            TWO,
            "virtual",
            ("right=a", "left=b"),
            None,
            [("virtual", "b", 500_000), ("virtual", "a", 1_000_000)],
        ),
    ],
)
def test_places(buses, interface, channels, bitrate, places):
    found = find_places(buses, interface, channels, bitrate)
    assert [place[:3] for place in found] == places
    assert all(place.data_bitrate is None for place in found)


def test_a_bus_of_can_fd_is_opened_as_one():
    (place,) = find_places((BusSettings(data_bitrate=5_000_000),), None, (), None)
    assert place[:4] == ("socketcan", "can0", 1_000_000, 5_000_000)


@pytest.mark.parametrize(
    ("buses", "channels", "said"),
    [
        (ONE, ("a", "b"), "2 channels; there is one bus"),
        (TWO, (), "bus left has no channel: --channel left="),
        (TWO, ("a", "b", "c"), "3 channels; the buses are left, right"),
        (TWO, ("left=a", "b"), "either every --channel is NAME=CHANNEL or none"),
        (TWO, ("middle=a",), "no bus is called middle; the buses are left, right"),
        (TWO, ("left=a", "left=b"), "a bus is named twice"),
        (TWO, ("can7",), "bus right is on socketcan can7, as another bus is"),
    ],
)
def test_channels_that_do_not_fit_the_buses_are_refused(buses, channels, said):
    with pytest.raises(AddressError, match=said):
        find_places(buses, None, channels, None)


def test_without_an_arm_the_usual_place_is_taken():
    (place,) = find_places((BusSettings(),), "udp_multicast", (), 125_000)
    assert str(place) == "udp_multicast 239.74.163.2"


def test_commands_for_one_bus_take_the_patches_of_that_bus():
    arm = load_arm("arm-two-buses")
    assert one_bus(arm, ["lower"]).node_id.tolist() == list(range(1, 22))
    assert bus_numbers(arm, ["lower"]) == [1]
    with pytest.raises(AddressError, match="say which by --bus: upper, lower"):
        one_bus(arm, ())
    with pytest.raises(AddressError, match="no bus of arm on two buses is called hand"):
        bus_numbers(arm, ["hand"])
    assert one_bus(load_arm("pad"), ()).n_patches == 1
