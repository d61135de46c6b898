"""The bus fails in every way it can: it is seen, published, survived, and nothing stale is ever shown."""

import time
from pathlib import Path

import pytest

from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.event import EventKind
from skinbus.can.frame import Frame
from skinbus.objects.cia import EmcyCode
from tests.socketcan.can_rig import ip, set_up
from tests.socketcan.skin_rig import PDO, Skin, assert_nothing_stale
from tests.socketcan.slcan_adapter import SlcanAdapter

EMCY = 0x0FF
"""Of the master."""


@pytest.fixture
def skin(tmp_path, channel):
    with Skin(tmp_path, channel) as skin:
        yield skin


def resident_kb():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def emcy_codes(frames):
    return [int.from_bytes(frame.data[:2], "little") for frame in frames if frame.can_id == EMCY]


def drain(bus):
    """All frames that wait."""
    frames = []
    while more := bus.receive():
        frames += more
    return frames


def history(skin):
    """Codes of the newest errors in the master's history (0x1003)."""
    return [skin.master.device.get(0x1003, sub) & 0xFFFF for sub in range(1, 5)]


def wait_for_contact(skin, since_s):
    """Wait for a contact of a cycle that began after this time.

    That it is back within a second is held on a virtual clock
    (``tests/master/test_freshness_after_faults.py``).
    """
    skin.wait_for(lambda: skin.pressed(since_s), "the contact")


def wait_for_emcy(skin, bus, *codes):
    """Wait until the master has told of these in this order; all frames until then."""
    frames = []

    def told():
        frames.extend(drain(bus))
        rest = iter(emcy_codes(frames))
        return all(code in rest for code in codes)

    skin.wait_for(told, f"EMCY {[hex(code) for code in codes]}")
    return frames


def test_interface_down_and_up_ten_times_in_the_middle_of_a_press(skin, channel):
    memory = []
    for k in range(10):
        skin.observer.close()
        set_up(channel, False)
        skin.wait_for_event(EventKind.BUS_LOST, k + 1)
        skin.wait_for_zero(0x3001, 5)
        time.sleep(1.7)  # longer than three heartbeats: all patches are given up
        assert not len(skin.reports[-1].contacts)
        up_s = time.monotonic()
        set_up(channel, True)
        skin.observer = SocketCanBus(channel)
        wait_for_contact(skin, up_s)
        skin.wait_for_zero(0x1001, 0)
        frames = drain(skin.observer)
        assert_nothing_stale(frames)
        memory.append(resident_kb())
    assert EmcyCode.BUS_OFF_RECOVERED in history(skin)
    assert memory[-1] - memory[4] < 2048
    assert skin.kinds().count(EventKind.BUS_LOST) == skin.kinds().count(EventKind.BUS_BACK) == 10


def test_interface_removed_and_plugged_again(skin, channel):
    ip("link", "del", channel)
    skin.wait_for_event(EventKind.BUS_LOST)
    skin.wait_for_zero(0x3001, 5)
    time.sleep(1.0)
    ip("link", "add", channel, "type", "vcan")
    up_s = time.monotonic()
    set_up(channel, True)
    with SocketCanBus(channel) as observer:
        wait_for_contact(skin, up_s)
        assert_nothing_stale(wait_for_emcy(skin, observer, EmcyCode.NO_ERROR))
    assert EmcyCode.BUS_OFF_RECOVERED in history(skin)


def test_error_passive_and_bus_off_are_published_and_survived(tmp_path, channel):
    with (
        SlcanAdapter(channel) as adapter,
        Skin(tmp_path, adapter.channel, sim_channel=channel) as skin,
        SocketCanBus(channel) as observer,
    ):
        adapter.say("sp000128")
        skin.wait_for_event(EventKind.ERROR_PASSIVE)
        adapter.say("sa000000")
        skin.wait_for_event(EventKind.ERROR_PASSIVE_END)
        skin.wait_for_zero(0x1001, 0)
        wait_for_emcy(skin, observer, EmcyCode.CAN_PASSIVE, EmcyCode.NO_ERROR)

        adapter.connected = False
        adapter.say("sb000255")
        skin.wait_for_event(EventKind.BUS_OFF)
        skin.wait_for_zero(0x3001, 5)
        drain(observer)
        ip("link", "set", adapter.channel, "down")  # slcan knows no other restart
        adapter.connected = True
        up_s = time.monotonic()
        set_up(adapter.channel, True)
        wait_for_contact(skin, up_s)
        skin.wait_for_zero(0x1001, 0)
        frames = wait_for_emcy(skin, observer, EmcyCode.BUS_OFF_RECOVERED, EmcyCode.NO_ERROR)
        assert_nothing_stale(frames)


def test_a_bus_that_takes_nothing_is_reported_and_survived(tmp_path, channel):
    with (
        SlcanAdapter(channel) as adapter,
        Skin(tmp_path, adapter.channel, sim_channel=channel) as skin,
        SocketCanBus(channel) as observer,
    ):
        adapter.listening = False
        skin.wait_for_event(EventKind.SEND_QUEUE_FULL)
        adapter.listening = True
        up_s = time.monotonic()
        skin.wait_for_event(EventKind.SEND_QUEUE_FULL_END)
        wait_for_contact(skin, up_s)
        skin.wait_for_zero(0x1001, 0)
        wait_for_emcy(skin, observer, EmcyCode.CAN_OVERRUN, EmcyCode.NO_ERROR)


@pytest.mark.parametrize("can_id", [0x000, 0x081, PDO, 0x333, 0x581, 0x7FF])
def test_a_babbling_node_is_found_published_and_survived(skin, channel, can_id):
    """0x333 is nobody's: the master does not listen to it, and finds it all the same."""

    def babble():
        sender.send([Frame(can_id, bytes([0xFF] * 8))] * 16)  # some 3000 a second
        heard.extend(drain(skin.observer))
        return EventKind.BABBLING in skin.kinds()

    def told(code, data):
        heard.extend(drain(skin.observer))
        emcy = [frame.data for frame in heard if frame.can_id == EMCY]
        return any(text[:2] == code.to_bytes(2, "little") and text[3:].startswith(data) for text in emcy)

    heard = []
    with SocketCanBus(channel) as sender:
        skin.wait_for(babble, "the babbler to be found")
    quiet_s = time.monotonic()
    wait_for_contact(skin, quiet_s)
    skin.wait_for_event(EventKind.BABBLING_END)
    events = [event for event in skin.events if event.kind in (EventKind.BABBLING, EventKind.BABBLING_END)]
    assert [event.cob_id for event in events] == [can_id, can_id]
    assert events[0].count > 500
    skin.wait_for(lambda: told(EmcyCode.COMMUNICATION, can_id.to_bytes(4, "little")), "its EMCY")
    skin.wait_for(lambda: told(EmcyCode.NO_ERROR, EmcyCode.COMMUNICATION.to_bytes(2, "little")), "its end")


def test_loss_while_the_reader_stands_still_is_published_to_the_frame(tmp_path, channel):
    with Skin(tmp_path, channel) as skin, SocketCanBus(channel) as sender:
        skin.freeze.set()
        skin.wait_for(skin.frozen.is_set, "the reader to stop")
        before = sum(frames_published(skin))
        end_s, n_sent = time.monotonic() + 2.0, 0
        while time.monotonic() < end_s:
            n_sent += sender.send([Frame(PDO, bytes(8))] * 256)
        skin.freeze.clear()
        back_s = time.monotonic()
        skin.wait_for(lambda: skin.pressed(back_s), "the contact")
        skin.wait_for_event(EventKind.FRAMES_DROPPED)
        n_overflow = sum(event.count for event in skin.events if event.kind == EventKind.FRAMES_DROPPED)
        skin.freeze.set()
        skin.wait_for(skin.frozen.is_set, "the reader to stop")
        told = sum(frames_published(skin)) - before
        n_cycle = 4 * (skin.n_reports + 1)  # what the patch itself sent
        assert EmcyCode.CAN_OVERRUN in history(skin)
        assert 0 < n_overflow < n_sent
        assert n_sent <= told <= n_sent + n_cycle


def frames_published(skin):
    """Accepted, unknown, bad length and lost frames in the master's objects."""
    return [skin.master.device.get(0x2200, sub) for sub in (1, 2, 3, 4)]
