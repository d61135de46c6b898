"""An upper arm of 35 triangles: MTB4 boards behind a gateway are felt as CANopen patches are."""

import numpy as np
import pytest

from skinbus.can.virtual_bus import VirtualBus
from skinbus.can.virtual_buses import VirtualBuses
from skinbus.config.system import load_arm, ods_of
from skinbus.gateway.frame_format import load_format
from skinbus.gateway.gateway import Gateway
from skinbus.master import Master
from skinbus.model import Surface
from skinbus.sim import World, load_scene
from tests.gateway import test_icub
from tests.gateway.doubles import Double

MS = 1_000_000
PRESS_S, PAUSE_S = 0.5, 0.5


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Five presses, one after the other, on the middles of triangles and between them."""
    monkeypatch.setattr(test_icub, "N_TRIANGLES", 36)
    monkeypatch.setattr(test_icub, "CUT", 99)
    rows = test_icub.table(Surface.cylinder(0.2, 0.045))
    answer = test_icub.imported(tmp_path, test_icub.text(rows))
    assert answer.exit_code == 0, answer.output
    file = tmp_path / "out" / "l_upper_arm.toml"
    arm = load_arm(file)
    assert arm.n_patches == 35
    rng = np.random.default_rng(5)
    text = f'[scene]\narm = "{file}"\nduration_s = 10.0\n'
    surface = arm.links[0].surface
    for k, tactel in enumerate(rng.choice(arm.n_tactels, 5, replace=False)):
        s, a = (
            arm.tactel_s[tactel] + rng.uniform(-2e-3, 2e-3),
            arm.tactel_a[tactel] + rng.uniform(-2e-3, 2e-3),
        )
        start_s = 1.5 + k * (PRESS_S + PAUSE_S)
        text += f"""[[touch]]
link = "{arm.links[0].name}"
s_mm = {1e3 * s}
angle_deg = {np.degrees(a / surface.radius)}
force_n = 5.0
start_s = {start_s}
end_s = {start_s + PRESS_S}
"""
    (tmp_path / "scene.toml").write_text(text)
    return load_scene(tmp_path / "scene.toml")


def seen(scene, wire, master_wire):
    """Play a scene; return for each of its touches the contacts of the cycles in its steady part."""
    reports = []
    master_wire.attach(Master(scene.arm, on_cycle=reports.append))
    wire.run(round(1e9 * (1.5 + 5 * (PRESS_S + PAUSE_S))))
    found = []
    for k in range(5):
        start_ns = round(1e9 * (1.5 + k * (PRESS_S + PAUSE_S)))
        inside = range(start_ns + 250 * MS, start_ns + 400 * MS)  # after the rise, before the fall
        found.append([report.contacts for report in reports if report.contacts.t_ns in inside])
    between = [r for r in reports if r.contacts.t_ns % (1000 * MS) in range(200 * MS, 480 * MS)]
    assert not any(len(report.contacts) for report in between)  # half a second after each press
    return found


def errors(scene, found):
    """Return errors (n, 2) of place, m, and of force, N: one of each touch."""
    surface, rows = scene.arm.links[0].surface, []
    for k, cycles in enumerate(found):
        truth = scene.touches_at(1.5 + k * (PRESS_S + PAUSE_S) + 0.3)
        assert cycles
        assert all(len(contacts) == 1 for contacts in cycles)
        last = cycles[-1]
        off = surface.distance(last.s[0], last.a[0], truth.s[0], truth.a[0])
        rows.append([off, abs(last.force[0] - truth.force[0])])
    return np.array(rows)


@pytest.mark.slow
def test_contacts_of_the_gateway_are_as_true_as_those_of_canopen_patches(scene):
    arm, found = scene.arm, load_format("icub-mtb4")
    wire = VirtualBus(arm.bus.bitrate)
    wire.attach(World(scene))
    canopen = errors(scene, seen(scene, wire, wire))
    wires = VirtualBuses([arm.bus.bitrate, found.bitrate])
    wires.attach(Gateway(found, arm, ods_of(arm)))
    wires.wires[1].attach(Double(found, arm, scene))
    gateway = errors(scene, seen(scene, wires, wires.wires[0]))
    print(1e3 * canopen[:, 0], 1e3 * gateway[:, 0], canopen[:, 1], gateway[:, 1])
    assert np.sqrt(np.mean(gateway[:, 0] ** 2)) < 1.2 * np.sqrt(np.mean(canopen[:, 0] ** 2)) + 0.1e-3
    assert np.sqrt(np.mean(gateway[:, 1] ** 2)) < 1.2 * np.sqrt(np.mean(canopen[:, 1] ** 2)) + 0.25
