"""Boards of skins that are not CANopen on one interface, their contacts on another."""

import pytest

from skinbus.bus.core_thread import CoreThread
from skinbus.bus.socketcan import SocketCanBus
from skinbus.gateway.frame_format import load_format
from tests.gateway.doubles import Double, write_scene
from tests.socketcan.processes import end, master_on, wait_for, wait_for_patches

S_MM, FORCE_N = 52.0, 4.0
PRESS = f"""[[touch]]
link = "plate"
s_mm = {S_MM}
a_mm = 1.0
force_n = {FORCE_N}
start_s = 0.0
end_s = 1000.0
"""


@pytest.fixture
def double(tmp_path):
    """Puts boards on a channel, which do not wait for a CPU; they are gone after the test."""
    threads = []

    def put(name, addresses, columns, rows, channel):
        scene = write_scene(tmp_path, addresses, columns, rows, touches=PRESS)
        file = tmp_path / "plate.toml"
        file.write_text(file.read_text().replace("rate_hz = 50.0", "rate_hz = 10.0"))  # a slow CPU keeps pace
        core = Double(load_format(name), scene.arm, scene)
        threads.append(CoreThread(core, lambda: SocketCanBus(channel), urgent=True))
        threads[-1].start()
        return str(file)

    yield put
    for thread in threads:
        thread.stop()


@pytest.mark.parametrize(
    ("name", "addresses", "columns", "rows"),
    [("icub-mtb4", ["2.0", "2.1", "3.7"], 5, 2), ("xela-uskin", ["1", "2", "3"], 4, 4)],
)
def test_a_touch_of_such_a_skin_is_a_contact_on_the_bus(
    start, double, make_channel, name, addresses, columns, rows
):
    skin, canopen = make_channel(), make_channel()
    arm = double(name, addresses, columns, rows, skin)
    gateway = start("gateway", name, arm, "--from", skin, "--to", canopen)
    run = start("run", arm, "-c", canopen, "--quiet")
    with master_on(canopen) as master:
        wait_for_patches(master, 3)
        contact = master["Contact 1"]
        wait_for(lambda: abs(contact["Force"].raw - FORCE_N) < 0.15 * FORCE_N)
        wait_for(
            lambda: abs(1e3 * contact["s"].raw - S_MM) < 0.5
        )  # asked again, where no answer came in time
    end(run)
    end(gateway)
