"""Readings that were sampled before the SYNC are used with their age, up to a limit."""

import numpy as np
import pytest

from skinbus.config.system import ods_of
from skinbus.node import Device, PatchHost, Sample
from skinbus.sim.sampler import Sampler
from tests.fd_arm import write_scene_file
from tests.master.rig import MS, Rig

SPEED = 0.05
"""Of the finger, m/s."""
SLIDE = "path = [[0.0, 35.0, 4.0], [2.0, 135.0, 4.0], [1000.0, 135.0, 4.0]]"


class FreeRunning(Rig):
    """Two boards on a plate under a finger that slides, each with samples of an age of its own."""

    def __init__(self, folder, limit=""):
        path = write_scene_file(folder, "skin-patch-fd")
        arm = folder / "fd.toml"
        arm.write_text(arm.read_text().replace("rate_hz", f"{limit}\nrate_hz", 1))
        path.write_text(path.read_text().replace("s_mm = 55.0\na_mm = 4.0", SLIDE))
        self.age_ms = np.zeros(2)
        self._start_ns = 1000 * MS
        super().__init__(path, self.host)

    def host(self, world):
        self._samplers = [Sampler(self.scene) for _ in range(2)]
        return PatchHost([Device(od, n) for n, od in enumerate(ods_of(self.scene.arm), 1)], self.newest)

    def newest(self, now_ns):
        t_ns = now_ns - (1e6 * self.age_ms).astype(np.int64)
        counts = np.zeros(self.scene.arm.n_tactels, np.int32)
        for p, sampler in enumerate(self._samplers):
            sampler.sample(max(1e-9 * (t_ns[p] - self._start_ns), 0.0))
            here = self.scene.arm.tactels_of(p)
            counts[here] = sampler.counts[here]
        return Sample(counts, t_ns, np.ones(len(counts), np.bool_))

    def place(self, t_ns):
        """Where the finger is, m."""
        return 0.035 + SPEED * 1e-9 * (t_ns - self._start_ns)


@pytest.mark.parametrize("age_ms", [0.0, 20.0, 60.0])
def test_track_is_where_the_finger_is_now_and_the_contact_is_of_its_sample(tmp_path, age_ms):
    rig = FreeRunning(tmp_path)
    rig.age_ms[:] = age_ms
    rig.run(1300)
    for cycle in rig.run(400)[0]:
        assert cycle.n_fresh == 2
        (track,) = range(len(cycle.tracks))
        assert cycle.t_ns - cycle.tracks.seen_ns[track] == pytest.approx(age_ms * MS, abs=0.1 * MS)
        assert cycle.tracks.mean[track, 0] == pytest.approx(rig.place(cycle.t_ns), abs=0.7e-3)
        assert cycle.contacts.s[0] == pytest.approx(rig.place(cycle.t_ns - age_ms * MS), abs=0.7e-3)


@pytest.mark.parametrize(
    ("limit", "age_ms", "fresh"),
    [("", 95.0, True), ("", 105.0, False), ("max_age_ms = 30", 25.0, True), ("max_age_ms = 30", 35.0, False)],
)
def test_sample_is_used_up_to_the_age_that_the_arm_file_allows_and_others_whatever_it_is(
    tmp_path, limit, age_ms, fresh
):
    rig = FreeRunning(tmp_path, limit=limit)
    rig.run(500)
    rig.age_ms[0] = age_ms
    rig.run(40)
    assert {(bool(cycle.fresh[0]), bool(cycle.fresh[1])) for cycle in rig.run(300)[0]} == {(fresh, True)}
    rig.age_ms[0] = 0.0
    rig.run(40)
    assert (rig.fresh(300) == 1.0).all(), "it is used again at once"
