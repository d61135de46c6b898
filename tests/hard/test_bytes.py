"""From counts to objects: counts of any value through the cycle of the master, and what it shows of them."""

import numpy as np
import pytest

from skinbus.config.system import load_arm, ods_of
from skinbus.estimate import LEVELS, Estimator
from skinbus.master.cycle import Cycle
from skinbus.master.gather import FrameCounters
from skinbus.master.publish import Publisher
from skinbus.node.device import Device
from skinbus.objects.eds import load_eds
from skinbus.objects.readings import ReadingsPlan
from tests.hard.check import check_contacts
from tests.marks import slow

PERIOD_NS = 20_000_000
N_QUIET = 30


def patterns(rng, n):
    """Counts of one cycle: ends of their range, noise about zero, some stuck at an end, anything."""
    for _ in range(N_QUIET):  # without a zero, bytes like these are noise, and nothing is published
        yield rng.integers(-30, 30, n)
    while True:
        yield rng.choice([-0x8000, 0x7FFF, 0, 1, -1], size=n)
        quiet = rng.integers(-30, 30, n)
        yield quiet
        yield np.where(rng.random(n) < 0.05, 0x7FFF, quiet)
        yield rng.integers(-0x8000, 0x8000, n)
        yield np.full(n, rng.choice([-0x8000, 0x7FFF]))


@pytest.mark.parametrize(
    ("name", "n_cycles", "zero_at_start"), [("pad", 60, False), ("pad", 60, True), *slow(("arm", 40, False))]
)
def test_any_counts_give_sound_contacts_and_tracks(name, n_cycles, zero_at_start):
    """Frames that are lost, late or in another order: ``tests/fuzz/test_fuzz_master.py``."""
    arm = load_arm(name)
    cycle = Cycle(arm, ReadingsPlan(arm, ods_of(arm)), Estimator(arm, "full"), zero_at_start=zero_at_start)
    full = np.array([p.patch.transducer.full_counts for p in arm.patches])[arm.tactel_patch]
    rng = np.random.default_rng(8)
    shown, n_contacts, t_ns = patterns(rng, arm.n_tactels), 0, 0
    for n in range(-N_QUIET, n_cycles):
        t_ns += PERIOD_NS if n < 0 else int(rng.choice([PERIOD_NS, 0, -PERIOD_NS, 10**9, 1]))
        counts = np.clip(next(shown), -full - 1, full).astype(np.int32)
        fresh, level = rng.random(arm.n_patches) > (0.04 if n >= 0 else 0.0), LEVELS[max(n, 0) % 3]
        contacts, tracks = cycle.run(t_ns, counts, fresh, level)
        assert not check_contacts(arm, contacts, level), n
        for column in (tracks.s, tracks.a, tracks.force, tracks.mean, tracks.covariance):
            assert np.isfinite(column).all(), n
        assert np.isfinite(cycle.baseline.zeros).all()
        assert np.isfinite([cycle.loads.force, cycle.loads.force_sd]).all()
        n_contacts += len(contacts)
    assert n_contacts > n_cycles / 4


def test_counters_of_frames_wrap_on_the_wire_and_go_on_inside():
    device = Device(load_eds("skin-master", 127), 127)
    publisher = Publisher(load_arm("pad"), [device])
    for count in (10**9, 2**31 - 1, 2**32 - 1, 2**32, 2**53 + 1, 2**64):
        publisher.frames(FrameCounters(accepted=count, unknown=count, bad_length=count, late=count))
        assert [device.get(0x2200, sub) for sub in (1, 2, 3)] == [count & 0xFFFFFFFF] * 3
