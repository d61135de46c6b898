"""Readings in frames: one table run both ways, and no bad frame that changes a reading."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from skinbus.can.frame import ERROR, EXTENDED, FD, RTR, Frame, FrameBatch
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, grid
from skinbus.objects.eds import load_eds
from skinbus.objects.readings import ReadingsPlan


def arm_of(eds, node_ids=(1,), n=(4, 4)):
    patch = Patch(tactels_uv=grid(*n, 0.005))
    placed = [PlacedPatch(patch=patch, node_id=i, link=0, s=0.05 * i, a=0.0, eds=eds) for i in node_ids]
    return Arm("test", [Link("plate", Surface.plane(1.0, 1.0))], placed)


def expected_node(eds, node_ids=(1,), n=(4, 4)):
    return ReadingsPlan(arm_of(eds, node_ids, n), [load_eds(eds, i) for i in node_ids])


def batch_of(*frames):
    batch = FrameBatch(max(8, len(frames)))
    batch.extend(frames)
    return batch


# EDS, node-IDs, tactel, counts, COB-ID, data
TABLE = [
    ("skin-patch", (1,), 0, 0x0102, 0x181, "0201 0000 0000 0000"),
    ("skin-patch", (1,), 0, -1, 0x181, "ffff 0000 0000 0000"),
    ("skin-patch", (1,), 3, 32767, 0x181, "0000 0000 0000 ff7f"),
    ("skin-patch", (1,), 4, -32768, 0x281, "0080 0000 0000 0000"),
    ("skin-patch", (1,), 15, 258, 0x481, "0000 0000 0000 0201"),
    ("skin-patch", (3, 126), 16, 5, 0x1FE, "0500 0000 0000 0000"),
    ("skin-patch", (3, 126), 15, 5, 0x483, "0000 0000 0000 0500"),
    ("skin-patch-8bit", (1,), 0, 127, 0x181, "7f00 0000 0000 0000"),
    ("skin-patch-8bit", (1,), 7, -128, 0x181, "0000 0000 0000 0080"),
    ("skin-patch-8bit", (1,), 8, -2, 0x281, "fe00 0000 0000 0000"),
]


@pytest.mark.parametrize(("eds", "node_ids", "tactel", "value", "cob_id", "data"), TABLE)
def test_table_unpacks(eds, node_ids, tactel, value, cob_id, data):
    plan = expected_node(eds, node_ids)
    counts, seen = np.full(plan.n_tactels, 99, np.int32), np.zeros(plan.n_patches, np.int32)
    assert plan.unpack(batch_of(Frame(cob_id, bytes.fromhex(data))), counts, seen) == (1, 0, 0)
    assert counts[tactel] == value
    assert (counts != 99).sum() == (8 if "8bit" in eds else 4)
    assert bin(seen[tactel // 16]).count("1") == 1


BAD = [
    (Frame(0x181, bytes(7)), "bad_length"),
    (Frame(0x181, b""), "bad_length"),
    (Frame(0x181, bytes(12), flags=FD), "bad_length"),
    (Frame(0x182, bytes(8)), "unknown"),
    (Frame(0x7FF, bytes(8)), "unknown"),
    (Frame(0x181, bytes(8), flags=RTR), "unknown"),
    (Frame(0x181, bytes(8), flags=EXTENDED), "unknown"),
    (Frame(0x181, bytes(8), flags=ERROR), "unknown"),
    (Frame(0x20000181, bytes(8), flags=EXTENDED), "unknown"),
    (Frame(0x800, bytes(8)), "unknown"),
    (Frame(0xFFFFFFFF, bytes(8)), "unknown"),
]


@pytest.mark.parametrize(("frame", "verdict"), BAD)
def test_bad_frame_is_counted_and_changes_nothing(frame, verdict):
    plan = expected_node("skin-patch")
    counts, seen = np.full(16, 42, np.int32), np.zeros(1, np.int32)
    result = plan.unpack(batch_of(frame), counts, seen)
    assert result.n_ok == 0
    assert (result.n_unknown, result.n_bad_length) == ((1, 0) if verdict == "unknown" else (0, 1))
    assert (counts == 42).all()
    assert not seen.any()


def test_plan_refuses_dictionaries_that_do_not_fit_the_arm():
    with pytest.raises(ValueError, match="1 object dictionaries for 2 patches"):
        ReadingsPlan(arm_of("skin-patch", (1, 2)), [load_eds("skin-patch", 1)])
    with pytest.raises(ValueError, match="0x181 is used twice"):
        ReadingsPlan(arm_of("skin-patch", (1, 2)), [load_eds("skin-patch", 1)] * 2)
    with pytest.raises(ValueError, match="reading 5 of 4 tactels"):
        expected_node("skin-patch", n=(2, 2))


@pytest.mark.parametrize(
    (
        "eds",
        "n",
        "tpdos",
    ),  # of a TPDO: COB-ID, its part of the bytes of the readings, bytes of its stamp, length
    [
        ("skin-patch-fd", (4, 4), [(0x180, slice(32), 4, 48)]),
        ("skin-patch-fd32", (8, 4), [(0x180, slice(62), 2, 64), (0x280, slice(62, 64), 4, 6)]),
    ],
)
def test_readings_of_can_fd_and_their_stamps_are_long_frames(eds, n, tpdos):
    plan = expected_node(eds, (1, 2), n)
    rng = np.random.default_rng(8)
    counts = rng.integers(-(2**15), 2**15, plan.n_tactels, np.int32)
    stamps = rng.integers(0, 256, (plan.n_frames, 4), np.uint8) * plan.stamped
    readings = map(bytes, counts.astype("<i2").reshape(2, -1))
    frames = [
        Frame(cob_id + node_id, (data[part] + stamp.tobytes()[:n_stamp]).ljust(length, b"\0"), flags=FD)
        for node_id, own, data in zip((1, 2), np.split(stamps, 2), readings, strict=True)
        for (cob_id, part, n_stamp, length), stamp in zip(tpdos, own, strict=True)
    ]
    back, seen, stamps_back = np.zeros_like(counts), np.zeros(2, np.int32), plan.new_stamps()
    assert plan.unpack(batch_of(*frames), back, seen, stamps=stamps_back) == (len(frames), 0, 0)
    assert_array_equal(back, counts)
    assert (seen == plan.expected).all()
    assert_array_equal(stamps_back, stamps)
    # counter, status, and the two bytes of an age
    assert plan.stamped.sum(axis=1).tolist() == [n_stamp for _, _, n_stamp, _ in tpdos] * 2


def test_frames_of_another_sync_change_nothing_and_those_that_do_not_come_leave_their_stamps():
    plan = expected_node("skin-patch-fd32", (1,), (8, 4))
    counts, seen, stamps = np.zeros(32, np.int32), np.zeros(1, np.int32), plan.new_stamps()
    answers = plan.answers()
    answers.due[:], answers.counter[:] = 1, 8
    for data in ([1, 0, 8, 2, 3, 4], [9, 0, 7, 5, 5, 5]):
        plan.unpack(batch_of(Frame(0x281, bytes(data))), counts, seen, stamps, answers)
    assert counts[31] == 1
    assert stamps.tolist() == [[0, 0, 0, 0], [8, 2, 3, 4]]
    assert seen.tolist() == [2]
