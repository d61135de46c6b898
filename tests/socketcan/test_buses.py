"""One master on several interfaces of a real kernel: sim in other processes; a bus that goes and comes."""

import threading
import time

from skinbus.bus.loop import Loop
from skinbus.bus.socketcan import SocketCanBus
from skinbus.can.event import EventKind
from skinbus.config.system import ods_of
from skinbus.master import Master
from skinbus.sim import World, load_scene
from tests.socketcan.can_rig import set_up
from tests.socketcan.skin_rig import PATIENCE_S, PRESS
from tests.two_buses import two_buses

TWO = two_buses(("left", 1, 28.0), ("right", 1, 80.0))


def test_interface_that_goes_and_comes_leaves_the_other_bus_alone(make_channel, tmp_path):
    left, right = make_channel(), make_channel()
    (tmp_path / "two.toml").write_text(TWO)
    press = PRESS.format(arm=tmp_path / "two.toml", link="plate")
    (tmp_path / "press.toml").write_text(press)
    scene = load_scene(tmp_path / "press.toml")
    reports, events, stop = [], [], threading.Event()
    world, master = World(scene, ods_of(scene.arm)), Master(scene.arm, on_cycle=reports.append)

    def run(core, on_event):
        opens = [lambda: SocketCanBus(left), lambda: SocketCanBus(right)]
        Loop(core, opens, stop, on_event=on_event).run()

    threads = [
        threading.Thread(target=run, args=(core, on)) for core, on in ((world, None), (master, events.append))
    ]
    for thread in threads:
        thread.start()

    def wait_until(happened):
        begin_s = time.monotonic()
        while not happened():
            assert time.monotonic() - begin_s < PATIENCE_S, events[-5:]
            time.sleep(0.005)
        return time.monotonic() - begin_s

    try:
        wait_until(lambda: reports and reports[-1].n_fresh == 2 and len(reports[-1].contacts))
        set_up(right, False)
        wait_until(lambda: EventKind.BUS_LOST in {event.kind for event in events})
        first = len(reports)
        wait_until(lambda: len(reports) >= first + 102)
        alone = reports[first + 2 :]
        set_up(right, True)
        back_s = wait_until(lambda: reports[-1].n_fresh == 2)
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    late_ms = sorted(report.latency_ns / 1e6 for report in alone)
    n_complete = sum(report.n_fresh for report in alone)
    print(
        f"right bus away: {len(alone)} cycles, {n_complete} complete, "
        f"latency {late_ms[len(alone) // 2]:.1f} ms, at most {late_ms[-1]:.1f} ms; back after {back_s:.2f} s"
    )
    assert {event.bus for event in events if event.kind in (EventKind.BUS_LOST, EventKind.BUS_BACK)} == {1}
    assert not [
        event for event in events if event.bus == 0 and event.node_id == 1 and event.kind != "patch-started"
    ]
    assert n_complete >= 0.5 * len(alone), "the machine may be held up, but not by the bus that is away"
    assert late_ms[len(alone) // 2] < 10.0, "half a period: a cycle that waits for the bus lasts a whole one"
