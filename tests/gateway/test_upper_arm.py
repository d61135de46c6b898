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
from skinbus.sim import Scene, Touch, World
from skinbus.sim.laws import Elastic
from tests.gateway import test_icub
from tests.gateway.doubles import Double

STARTS_S = 1.2 + 0.8 * np.arange(5)
FORCE = np.array([[0.0, 0.0], [0.1, 5.0], [0.4, 5.0], [0.5, 0.0]])


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """Five presses, one after the other, on the middles of triangles and between them."""
    monkeypatch.setattr(test_icub, "N_TRIANGLES", 36)
    monkeypatch.setattr(test_icub, "CUT", 99)
    rows = test_icub.table(Surface.cylinder(0.2, 0.045))
    answer = test_icub.imported(tmp_path, test_icub.text(rows))
    assert answer.exit_code == 0, answer.output
    arm = load_arm(tmp_path / "out" / "l_upper_arm.toml")
    assert arm.n_patches == 35
    rng, touches = np.random.default_rng(5), []
    for start_s, tactel in zip(STARTS_S, rng.choice(arm.n_tactels, 5, replace=False), strict=True):
        s, a = rng.uniform(-2e-3, 2e-3, 2) + np.array([arm.tactel_s[tactel], arm.tactel_a[tactel]])
        touches.append(Touch(link=0, path=np.array([[0.0, s, a]]), force=FORCE + np.array([start_s, 0.0])))
    return Scene("presses", arm, duration_s=10.0, layer=Elastic(), touches=touches)


def errors(scene, wire, master_wire):
    """Play a scene; return RMS errors of place, m, and of force, N, in the steady parts of its touches."""
    cycles, rows = [], []
    master_wire.attach(Master(scene.arm, on_cycle=lambda report: cycles.append(report.contacts)))
    wire.run(round(1e9 * (STARTS_S[-1] + 0.8)))
    for start_s in STARTS_S:
        since_s = np.array([1e-9 * cycle.t_ns - start_s for cycle in cycles])
        steady = [cycles[k] for k in np.flatnonzero((since_s >= 0.25) & (since_s < 0.4))]
        assert [len(contacts) for contacts in steady] == [1] * len(steady) != []
        gone = [cycles[k] for k in np.flatnonzero((since_s >= 0.7) & (since_s < 0.78))]
        assert not any(map(len, gone))
        last, truth = steady[-1], scene.touches_at(start_s + 0.3)
        off = scene.arm.links[0].surface.distance(last.s[0], last.a[0], truth.s[0], truth.a[0])
        rows.append([off, last.force[0] - truth.force[0]])
    return np.sqrt(np.mean(np.square(rows), axis=0))


@pytest.mark.slow
def test_contacts_of_the_gateway_are_as_true_as_those_of_canopen_patches(scene):
    arm, found = scene.arm, load_format("icub-mtb4")
    wire = VirtualBus(arm.bus.bitrate)
    wire.attach(World(scene))
    canopen = errors(scene, wire, wire)
    wires = VirtualBuses([arm.bus.bitrate, found.bitrate])
    wires.attach(Gateway(found, arm, ods_of(arm)))
    wires.wires[1].attach(Double(found, arm, scene))
    gateway = errors(scene, wires, wires.wires[0])
    assert (gateway < 1.2 * canopen + (0.1e-3, 0.25)).all()
