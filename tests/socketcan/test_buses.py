"""One master on two interfaces of a real kernel; one that goes and comes leaves the other alone."""

from skinbus.can.event import EventKind
from tests.files import put
from tests.socketcan.can_rig import set_up
from tests.socketcan.skin_rig import Skin
from tests.two_buses import two_buses

TWO = two_buses(("left", 1, 28.0), ("right", 1, 80.0)).replace("rate_hz = 50.0", "rate_hz = 10.0")


def test_interface_that_goes_and_comes_leaves_the_other_bus_alone(make_channel, tmp_path):
    left, right = make_channel(), make_channel()
    with Skin(tmp_path, left, right, arm=put(tmp_path, "two.toml", TWO)) as skin:
        skin.wait_for(lambda: skin.reports[-1].n_fresh == 2, "both boards")
        set_up(right, False)
        skin.wait_for_event(EventKind.BUS_LOST)
        alone = []

        def many_cycles():
            alone.extend(report for report in skin.reports if not alone or report.t_ns > alone[-1].t_ns)
            return len(alone) > 60

        skin.wait_for(many_cycles, "cycles of the other bus")
        set_up(right, True)
        skin.wait_for(lambda: skin.reports[-1].n_fresh == 2, "the board of the bus")
    del alone[:20]  # of before
    late_ns = sorted(report.latency_ns for report in alone)
    n_complete = sum(report.n_fresh for report in alone)
    lost = {event.bus for event in skin.events if event.kind in (EventKind.BUS_LOST, EventKind.BUS_BACK)}
    assert lost == {1}
    of_left = {event.kind for event in skin.events if event.bus == 0 and event.node_id == 1}
    assert of_left <= {EventKind.PATCH_STARTED}
    assert n_complete >= 0.5 * len(alone), "the machine may be held up, but not by the bus that is away"
    assert late_ns[len(alone) // 2] < 50e6, "half a period: a cycle that waits for the bus lasts a whole one"
