"""The guard of a patch: it trips when a plain comparison does, and says who and where."""

import numpy as np
import pytest

from skinbus.can.frame import Frame
from skinbus.node import Device
from skinbus.objects.eds import load_eds
from skinbus.objects.guard import GFC_ID, NO_LIMIT, GuardLimits

MS, N = 1_000_000, 16
START, SYNC = Frame(0x000, b"\x01\x00"), Frame(0x080)
ACKNOWLEDGE = Frame(0x605, bytes.fromhex("23 80 20 03 61 63 6B 6E"))


def plain(n, m, sum_limit, limits, weights, rest, samples):
    """Return for each sample the tactel (0: the sum) and the value that trips a guard, None if it does not.

    A sample is counts, or None: the guard is acknowledged.
    """
    last, trips = [], [None]
    is_tripped = False
    for counts in samples:
        trips.append(None)
        if counts is None:
            last, is_tripped = [] if is_tripped else last, False
            continue
        pairs = enumerate(zip(counts, limits, strict=True), 1)
        over = [(k, count) for k, (count, limit) in pairs if count > limit]
        total = sum(w * max(c - z, 0) for w, z, c in zip(weights, rest, counts, strict=True))
        last = [*last, bool(over) or total > sum_limit][-m:]
        if last[-1] and sum(last) >= n and not is_tripped:
            trips[-1], is_tripped = [*over, (0, total)][0], True
    return trips[1:]


@pytest.mark.parametrize(
    ("eds", "index", "counts"),
    [
        ("skin-patch", 0x6401, [-0x8000, 99, 100, 101, 300, 0x7FFF]),
        ("skin-patch-8bit", 0x6400, [-0x80, 0, 40, 41, 42, 0x7F]),
    ],
)
def test_it_trips_on_the_samples_on_which_a_plain_comparison_does(eds, index, counts):
    rng = np.random.default_rng(40)
    n_trips = 0
    for _ in range(60):
        m = int(rng.integers(1, 9))
        n = int(rng.integers(1, m + 1))
        limits = np.where(rng.random(N) < 0.1, rng.choice(counts, N), NO_LIMIT)
        weights = rng.choice([0, 0, 1, 511], N)
        rest = rng.integers(-9, 9, N)
        sum_limit = int(rng.choice([-1, 0, 300, 100_000, 2**31 - 1]))
        samples = [(rng.choice(counts, N) * (rng.random(N) < 0.2)).tolist() for _ in range(30)]
        samples = [None if rng.random() < 0.1 else sample for sample in samples]
        device = Device(load_eds(eds, 5), 5)
        device.step(0)
        device.step(0, [START])
        device.set(0x2081, 0, GuardLimits(n, m, sum_limit, limits, weights, rest).encode())
        wanted = plain(n, m, sum_limit, limits.tolist(), weights.tolist(), rest.tolist(), samples)
        for k, (sample, trip) in enumerate(zip(samples, wanted, strict=True), 1):
            if sample is None:
                device.step(k * MS, [ACKNOWLEDGE])
                continue
            device.image_view(index, 1, N)[:] = sample
            device.sampled(0)
            sent = device.step(k * MS, [SYNC]).frames
            told = [(frame.can_id, frame.data) for frame in sent if frame.can_id in (GFC_ID, 0x085)]
            if trip is None:
                assert told == []
                continue
            who, value = trip
            emcy = b"\x02\xff\x81" + bytes([who]) + value.to_bytes(4, "little", signed=True)
            assert told == [(GFC_ID, b""), (0x085, emcy)]
            assert sent[0].can_id == GFC_ID
            n_trips += 1
    assert n_trips > 60
