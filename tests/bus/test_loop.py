"""The loop that owns a core on an interface, on a virtual clock and an interface that moves it."""

import pytest

from skinbus.bus.loop import Loop
from skinbus.can.clock import VirtualClock
from skinbus.can.core import NEVER, Core, Step
from skinbus.can.event import Event, EventKind
from skinbus.can.frame import Frame
from skinbus.errors import BusError
from tests.bus.cores import Talker
from tests.bus.loop_rig import CALL_NS, MS, FakeBus, VirtualStop, run


def test_core_is_woken_at_its_times_and_no_earlier():
    core = Talker([(t_ns, Frame(0x80)) for t_ns in (0, 20 * MS, 40 * MS, 5_000 * MS)])
    (bus,), report = run(core, until_ns=6_000 * MS)
    late = [
        t_ns - wanted for (t_ns, _), wanted in zip(bus.sent, (0, 20 * MS, 40 * MS, 5_000 * MS), strict=True)
    ]
    assert all(0 <= late_ns <= 2 * CALL_NS for late_ns in late)
    assert report.n_sent == 4
    assert report.steps == 4


def test_stop_event_of_the_core_ends_the_loop_after_its_frames_are_sent():
    class Last(Core):
        cob_ids = None

        def step(self, now_ns, frames):
            return Step((Frame(0x000, b"\x80\x00"),), (Event(t_ns=now_ns, kind=EventKind.STOP),), NEVER)

    events = []
    (bus,), report = run(Last(), until_ns=NEVER, on_event=events.append)
    assert report.steps == 1
    assert [frame.can_id for _, frame in bus.sent] == [0]
    assert [event.kind for event in events] == [EventKind.STOP]
    assert not bus.is_open


class Failing(Talker):
    """A core that fails in its first step."""

    def step(self, now_ns, frames):
        raise KeyError("the core")


@pytest.mark.parametrize("core", [Talker(), Failing()])
@pytest.mark.parametrize("fails", ["last_frames", "close", "last_frames and close"])
def test_buses_are_closed_and_the_first_error_is_raised_whatever_fails(core, fails):
    clock = VirtualClock()
    buses = [FakeBus(clock), FakeBus(clock)]

    class Two(Core):
        cob_ids, n_buses, step = core.cob_ids, 2, core.step

        def cob_ids_on(self, bus):
            return None

        def last_frames(self, now_ns):
            if "last_frames" in fails:
                raise ValueError("the last frames")
            return ()

    def close(self=buses[1]):
        self.is_open = False
        if "close" in fails:
            raise BusError("the bus")

    buses[1].close = close
    all_of = {KeyError: isinstance(core, Failing), ValueError: "last" in fails, BusError: "close" in fails}
    first, *others = [error for error, is_so in all_of.items() if is_so]
    settings = {"stop": VirtualStop(clock, MS), "clock": clock}
    with pytest.raises(first) as caught:
        Loop(Two(), [bus.open for bus in buses], **settings).run()
    assert [bus.is_open for bus in buses] == [False, False]
    assert [note.split("(")[0] for note in getattr(caught.value, "__notes__", [])] == [
        f"then: {e.__name__}" for e in others
    ]


@pytest.mark.parametrize("outage", [None, (2 * MS, 8 * MS)])
def test_frames_that_did_not_go_out_are_given_back_to_a_core_that_wants_to_know(outage):
    class Teller(Talker):
        def __init__(self, plan):
            super().__init__(plan)
            self.back = []

        def not_sent(self, now_ns, frames):
            self.back += frames

    core = Teller([(MS, Frame(0x81)), (5 * MS, Frame(0x82)), (300 * MS, Frame(0x83))])
    (bus,), report = run(core, until_ns=400 * MS, outage=outage)
    swallowed = [] if outage is None else [0x82]
    assert [frame.can_id for frame in core.back] == swallowed
    assert report.n_lost == len(swallowed)
    assert [frame.can_id for _, frame in bus.sent] == [i for i in (0x81, 0x82, 0x83) if i not in swallowed]


class TwoBuses(Talker):
    """Talks and listens on two buses."""

    n_buses = 2

    def cob_ids_on(self, bus):
        return self.cob_ids


def test_frames_carry_the_number_of_their_bus_both_ways():
    core = TwoBuses([(MS, Frame(0x80)), (MS, Frame(0x80, bus=1)), (2 * MS, Frame(0x81, bus=1))])
    buses, report = run(
        core, until_ns=9 * MS, arrivals=[Frame(0x181, t_ns=3 * MS), Frame(0x181, t_ns=5 * MS, bus=1)]
    )
    assert [(frame.can_id, frame.bus) for frame in core.heard] == [(0x181, 0), (0x181, 1)]
    assert [[frame.can_id for _, frame in bus.sent] for bus in buses] == [[0x80], [0x80, 0x81]]
    assert (report.n_sent, report.n_received) == (3, 2)


def test_bus_that_is_lost_does_not_hold_up_the_other():
    ticks = [k * 20 * MS for k in range(100)]
    core = TwoBuses([(t_ns, Frame(0x80, bus=bus)) for t_ns in ticks for bus in (0, 1)])
    arrivals = [Frame(0x181, t_ns=t_ns + 2 * MS, bus=1) for t_ns in ticks]
    events = []
    buses, report = run(
        core,
        until_ns=2_000 * MS,
        arrivals=arrivals,
        outage=(500 * MS, 1_500 * MS),
        on_event=events.append,
    )
    assert [(event.kind, event.bus) for event in events] == [(EventKind.BUS_LOST, 0), (EventKind.BUS_BACK, 0)]
    assert 1_500 * MS <= events[1].t_ns <= 1_760 * MS
    # On the other bus every frame came, and went, in time.
    late_ns = [at_ns - wanted for (at_ns, _), wanted in zip(buses[1].sent, ticks, strict=True)]
    assert max(late_ns) <= 2 * MS
    assert len(core.heard) == len(ticks)
    assert report.n_outages == 1
    assert report.n_lost == len(ticks) - len(buses[0].sent)
