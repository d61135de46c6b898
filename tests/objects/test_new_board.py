"""A new board is complete: other tools read it, all readings are sent, and no two of them clash."""

import canopen
import numpy as np
import pytest

from skinbus.model import grid
from skinbus.objects.board import describe_patch
from skinbus.objects.cia import restricted
from skinbus.objects.eds import load_eds, read_eds
from skinbus.objects.eds_lint import lint
from skinbus.objects.new_board import NewBoard
from skinbus.objects.pdo import readings_in, tpdos
from tests.files import put

BOARDS = [
    (1, 1, 5.0, 8, False, 8, 1),
    (4, 4, 10.0, 16, False, 16, 4),
    (6, 6, 8.0, 12, False, 8, 5),
    (4, 8, 5.0, 12, False, 16, 8),
    (8, 8, 5.5, 12, False, 8, 8),
    (3, 5, 7.5, 10, False, 16, 4),
    (2, 2, 7.5, 8, True, 16, 1),
    (6, 6, 8.0, 12, True, 16, 2),
    (8, 8, 5.5, 16, True, 16, 3),
]


@pytest.fixture(
    params=BOARDS, ids=lambda board: f"{board[0]}x{board[1]}-{board[3]}{'-fd' * board[4]}", scope="module"
)
def made(request, tmp_path_factory):
    columns, rows, pitch_mm, bits, canfd, *wanted = request.param
    pitch = 1e-3 * pitch_mm
    board = NewBoard(
        name="my.eds", tactels_uv=grid(columns, rows, pitch), pitch=pitch, bits=bits, canfd=canfd
    )
    path = put(tmp_path_factory.mktemp("made"), "my.eds", board.text())
    assert [board.reading_bits, len(board.mapped)] == wanted
    return board, path


def test_it_has_no_fault_and_describes_the_grid(made):
    board, path = made
    assert lint(read_eds(path)) == []
    od = load_eds(path, 7)
    patch = describe_patch(od)
    assert patch.n_tactels == board.n_tactels
    assert patch.tactels_uv == pytest.approx(board.tactels_uv, abs=1e-6)
    assert (np.abs(patch.tactels_uv) + 0.5 * patch.diameter <= 0.5 * np.array(patch.size)).all()
    assert (patch.transducer.bits, patch.transducer.converter_bits) == (board.reading_bits, board.bits)
    assert patch.healthy.all()


def test_two_boards_never_share_an_identifier(made):
    _, path = made
    first, last = ([pdo.cob_id for pdo in tpdos(load_eds(path, n)) if pdo.valid] for n in (1, 127))
    assert last == [cob_id + 126 for cob_id in first]
    assert (np.diff(sorted(first)) > 126).all()


def test_its_guard_has_an_identifier_of_its_own_and_is_off(made):
    _, path = made
    sent = tpdos(load_eds(path, 47))
    ids = [pdo.cob_id for pdo in sent] + [pdo.cob_id for pdo in tpdos(load_eds("skin-master", 127))]
    assert len(set(ids)) == len(ids)
    assert not restricted(sent[-1].cob_id)
    assert (sent[-1].number, sent[-1].valid, sent[-1].length) == (9, False, 2)


def test_every_reading_is_sent_once_in_frames_of_its_bus(made):
    board, path = made
    sent = [pdo for pdo in tpdos(load_eds(path, 7)) if pdo.valid]
    subs = [entry.sub for pdo in sent for entry in readings_in(pdo)]
    assert subs == list(range(1, board.n_tactels + 1))
    assert max(pdo.length for pdo in sent) <= (64 if board.canfd else 8)


def test_another_tool_reads_it_and_numbers_are_decimal(made):
    board, path = made
    text = path.read_text()
    od = canopen.import_od(str(path), node_id=5)
    assert od["Board"]["Tactel count"].default == board.n_tactels
    assert od["Tactel u um"][board.n_tactels].name == f"u of tactel {board.n_tactels}"
    reals = [part for part in text.split("\n\n") if "DataType=0x0008" in part]
    assert reals
    assert all(np.isfinite(float(part.partition("DefaultValue=")[2].split()[0])) for part in reals)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"tactels_uv": grid(11, 6, 8e-3)}, "66 tactels"),
        ({"tactels_uv": grid(0, 6, 8e-3)}, "0 tactels"),
        ({"tactels_uv": np.full((2, 2), np.nan)}, "from the centre"),
        ({"pitch": 1e-4}, "pitch"),
        ({"bits": 24}, "24 bits"),
    ],
    ids=lambda x: str(x)[:20],
)
def test_what_cannot_be_is_refused(change, said):
    usual = {"name": "x.eds", "tactels_uv": grid(6, 6, 8e-3), "pitch": 8e-3, "bits": 12}
    with pytest.raises(ValueError, match=said):
        NewBoard(**(usual | change))


@pytest.mark.parametrize(
    ("grid_of", "bits", "canfd", "stamps"),
    [
        ((5, 2), 12, False, [[], [], [3, 2, 1]]),
        ((5, 3), 12, False, [[], [], [], [3]]),
        ((7, 1), 8, False, [[2]]),
        ((4, 4), 12, False, [[], [], [], []]),
        ((4, 4), 12, True, [[1, 2, 3]]),
        ((8, 4), 12, True, [[1, 2], [1, 2, 3]]),
    ],
)
def test_age_of_samples_is_mapped_where_there_is_room(grid_of, bits, canfd, stamps, tmp_path):
    board = NewBoard(name="my.eds", tactels_uv=grid(*grid_of, 8e-3), pitch=8e-3, bits=bits, canfd=canfd)
    put(tmp_path, "my.eds", board.text())
    sent = [pdo for pdo in tpdos(load_eds(tmp_path / "my.eds", 7)) if pdo.valid]
    assert [[e.sub for e in pdo.entries if e.index == 0x2070] for pdo in sent] == stamps
