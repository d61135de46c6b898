"""Readings of any board: random mappings against single bits, and an 8 x 8 patch from its EDS alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from skinbus.can.frame import Frame, FrameBatch
from skinbus.model import Arm, Link, Patch, PlacedPatch, Surface, grid
from skinbus.objects import cia
from skinbus.objects.eds import build_od
from skinbus.objects.eds_file import read_text
from skinbus.objects.eds_values import TYPES
from skinbus.objects.readings import ReadingsPlan

READING_TYPES = [2, 3, 4, 5, 6, 0x10, 0x16]  # of 8 to 32 bits, signed and not
DUMMY_TYPES = [1, 2, 3, 4, 5, 6, 7]

entries = st.one_of(
    st.tuples(st.just("reading"), st.sampled_from(READING_TYPES)),
    st.tuples(st.just("dummy"), st.sampled_from(DUMMY_TYPES)),
)


@st.composite
def boards(draw):
    """Return the TPDOs of a board: lists of (tactel or None, data type), every tactel once, in any order."""
    pdos = []
    for _ in range(draw(st.integers(1, 5))):
        pdo, room = [], 64
        for kind, data_type in draw(st.lists(entries, min_size=1, max_size=8)):
            if TYPES[data_type].bits <= room:
                room -= TYPES[data_type].bits
                pdo.append((kind, data_type))
        pdos.append(pdo)
    n = sum(kind == "reading" for pdo in pdos for kind, _ in pdo)
    order = iter(draw(st.permutations(range(n))))
    return [[(next(order) if kind == "reading" else None, t) for kind, t in pdo] for pdo in pdos], n


def section(index, sub, data_type, default=None):
    name = f"{index:04X}" if sub is None else f"{index:04X}sub{sub:X}"
    lines = [f"[{name}]", f"ParameterName={name}", f"DataType={data_type}", "AccessType=rw", "PDOMapping=1"]
    return [*lines, f"DefaultValue={default}"] if default is not None else lines


def board_od(pdos):
    """Return the dictionary of a board whose readings have the types that its mapping says."""
    lines = ["[DummyUsage]", *(f"Dummy{t:04X}=1" for t in DUMMY_TYPES)]
    lines += [f"[{cia.READ_ANALOGUE_16:04X}]", "ParameterName=Readings", "ObjectType=0x8"]
    for pdo in pdos:
        for tactel, data_type in pdo:
            if tactel is not None:
                lines += section(cia.READ_ANALOGUE_16, tactel + 1, data_type)
    for k, pdo in enumerate(pdos):
        lines += [f"[{0x1800 + k:04X}]", "ParameterName=C", "ObjectType=0x9"]
        lines += section(0x1800 + k, 1, 7, 0x181 + 0x10 * k)
        lines += [f"[{0x1A00 + k:04X}]", "ParameterName=M", "ObjectType=0x9"]
        lines += section(0x1A00 + k, 0, 5, len(pdo))
        for sub, (tactel, data_type) in enumerate(pdo, 1):
            bits = TYPES[data_type].bits
            index, entry = (data_type, 0) if tactel is None else (cia.READ_ANALOGUE_16, tactel + 1)
            word = index << 16 | entry << 8 | bits  # CiA 301, 7.5.2.36
            lines += section(0x1A00 + k, sub, 7, word)
    file = read_text("\n".join(lines), name="board.eds")
    assert not file.faults
    return build_od(file, 1)


def expected_node(od, n):
    patch = Patch(tactels_uv=grid(n, 1, 0.001))
    placed = PlacedPatch(patch=patch, node_id=1, link=0, s=0.5, a=0.0)
    return ReadingsPlan(Arm("board", [Link("plate", Surface.plane(1.0, 1.0))], [placed]), [od])


def bits_of(pdo, counts, dummy):
    """Return the payload of a PDO, put together bit by bit; a function of their bits gives dummies."""
    word = offset = 0
    for tactel, data_type in pdo:
        bits = TYPES[data_type].bits
        value = dummy(bits) if tactel is None else int(counts[tactel])
        word |= (value & ((1 << bits) - 1)) << offset
        offset += bits
    return word.to_bytes(-(-offset // 8), "little")


@pytest.mark.slow
@settings(max_examples=150)
@given(boards(), st.randoms(use_true_random=False))
def test_any_mapping_unpacks_bit_by_bit_whatever_its_dummies_hold(board, random):
    pdos, n = board
    if n == 0:
        return
    ranges = {tactel: TYPES[t] for pdo in pdos for tactel, t in pdo if tactel is not None}
    sent = np.array([random.randint(ranges[k].low, ranges[k].high) for k in range(n)], np.int64).astype(
        np.int32
    )
    plan = expected_node(board_od(pdos), n)
    carriers = [(k, pdo) for k, pdo in enumerate(pdos) if any(tactel is not None for tactel, _ in pdo)]
    batch = FrameBatch(8)
    batch.extend([Frame(0x181 + 0x10 * k, bits_of(pdo, sent, random.getrandbits)) for k, pdo in carriers])
    got, seen = np.zeros(n, np.int32), np.zeros(1, np.int32)
    assert plan.unpack(batch, got, seen) == (len(carriers), 0, 0)
    assert_array_equal(got, sent)
    assert_array_equal(seen, plan.expected)


@pytest.mark.parametrize("data_type", [7, 0x15, 0x1B])
def test_reading_that_does_not_fit_an_int32_is_refused(data_type):
    with pytest.raises(ValueError, match="does not fit an int32"):
        expected_node(board_od([[(0, data_type)]]), 1)
