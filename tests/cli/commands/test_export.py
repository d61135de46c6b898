"""`skinbus export`: what other readers find in the files is what was on the bus, value by value."""

import csv
import json
import shutil
from contextlib import closing
from pathlib import Path

import cantools
import numpy as np
import pyarrow.parquet as pq
import pytest
from foxglove_schemas_protobuf import PointCloud_pb2, SceneUpdate_pb2
from mcap.reader import make_reader

from skinbus.can.candump import CandumpWriter, format_line
from tests.cli.commands.recordings import WallClock, changed, frames_in
from tests.cli.invoke import run
from tests.master.buses_rig import ON_SEAM, BusesRig, write_scene

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A log of two buses with a press on their seam, and its arm file."""
    folder = tmp_path_factory.mktemp("both")
    rig = BusesRig(write_scene(folder, [ON_SEAM]))
    path = folder / "both.log"
    with closing(CandumpWriter(path, clock=WallClock(), channels=("can0", "can1"))) as writer:
        for bus, wire in enumerate(rig.wires.wires):
            wire.tap(lambda frame, bus=bus: writer.write([frame._replace(bus=bus)]))
        rig.run(1000.0)
    return path, folder / "arm.toml"


@pytest.fixture
def here(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def exported(*args, **settings):
    return run("export", *args, **settings)


@pytest.fixture(scope="module")
def files(field, tmp_path_factory):
    """A folder with what is exported of the recording of the pad."""
    folder = tmp_path_factory.mktemp("files")
    for name in ("x.mcap", "x.parquet"):
        exported(field, "--arm", "pad", "--out", folder / name)
    return folder


def decoded_by_cantools(arm, log, channel="can0", bus=""):
    """Readings as cantools makes them of the DBC: {(time of the SYNC before, node, tactel): Pa}."""
    exported("--arm", arm, "--out", "x.dbc")
    (path,) = Path.cwd().glob(f"x{bus}.dbc")
    database = cantools.database.load_file(path)
    known = {message.frame_id: message for message in database.messages if "patch" in message.senders[0]}
    syncs = np.array([frame.t_ns for frame in frames_in(log) if frame.can_id == 0x80])
    found = {}
    for frame in frames_in(log, channel):
        if message := known.get(frame.can_id):
            cycle = syncs[np.searchsorted(syncs, frame.t_ns, "right") - 1]
            node = int(message.senders[0].removeprefix("patch_"))
            for name, value in message.decode(frame.data).items():
                found[int(cycle), node, int(name.removeprefix("tactel_"))] = value
    return found


def check_readings(rows, expected):
    """Readings {key: Pa} against those of cantools, except in the first and last cycle."""
    cycles = {key[0] for key in expected}
    ends = min(cycles), max(cycles)
    assert len(expected) > 300
    assert {key for key in expected if key[0] not in ends} <= set(rows) <= set(expected)
    for key, pressure in rows.items():
        assert pressure == pytest.approx(expected[key], rel=1e-6, abs=1e-3)


def test_parquet_holds_every_reading_of_every_cycle(field, here):
    said = exported(field, "--arm", "pad", "--out", "x.parquet", "--level", "kmeans")
    table = pq.read_table("x.parquet").to_pydict()
    keys = zip(table["t_ns"], table["node_id"], table["tactel"], strict=True)
    check_readings(dict(zip(keys, table["pressure_pa"], strict=True)), decoded_by_cantools("pad", field))
    assert "1188 frames used" in said
    assert set(table["link"]) == {"plate"}
    # the zero of a tactel hardly moves while it is touched: what is taken off is the same from cycle to cycle
    zeroed, raw = (np.array(table[name], float) for name in ("zeroed_pa", "pressure_pa"))
    used = ~np.isnan(zeroed)
    assert used.mean() > 0.9
    assert zeroed[used].max() > 1000.0
    for k in range(1, 17):
        taken = (raw - zeroed)[used & (np.array(table["tactel"]) == k)]
        assert np.ptp(taken[5:]) < 0.2 * np.ptp(raw)


def test_an_arm_of_two_buses_has_a_dbc_for_each_and_all_its_readings(both, here):
    log, arm = both
    exported(log, "--arm", arm, "-c", "left=can0", "-c", "right=can1", "--out", "x.parquet")
    table = pq.read_table("x.parquet").to_pylist()
    for bus, channel in (("left", "can0"), ("right", "can1")):
        rows = {(r["t_ns"], r["node_id"], r["tactel"]): r["pressure_pa"] for r in table if r["bus"] == bus}
        check_readings(rows, decoded_by_cantools(arm, log, channel, f"-{bus}"))


def test_parquet_has_the_contacts_of_replay(field, files, here):
    table = pq.read_table(files / "x.contacts.parquet").to_pylist()
    run("replay", field, "--arm", "pad", "--out", "replay.csv")
    expected = list(csv.DictReader(Path("replay.csv").read_text().splitlines()))
    assert len(table) == len(expected) > 20
    for row, other in zip(table, expected, strict=True):
        assert {name: "" if cell is None else str(cell) for name, cell in row.items()} == other
        assert row["cov_s_s"] > 0.0
        assert row["x_m"] == pytest.approx(row["s_m"])


KINDS = {
    "foxglove.PointCloud": PointCloud_pb2.PointCloud,
    "foxglove.SceneUpdate": SceneUpdate_pb2.SceneUpdate,
}
"""Foxglove's own description of its messages."""
TYPES = {1: "u1", 6: "<i4", 7: "<f4", 8: "<f8"}


def messages_of(path):
    """(time, content) by topic, as Foxglove's library reads them."""
    found = {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            kind = KINDS.get(schema.name)
            content = kind.FromString(message.data) if kind else json.loads(message.data)
            assert kind or json.loads(schema.data)["title"] == schema.name
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def test_mcap_holds_readings_and_contacts_in_messages_that_foxglove_knows(files):
    topics = messages_of(files / "x.mcap")
    counts = {}
    for t_ns, cloud in topics["/pressures"]:
        dtype = np.dtype(
            {
                "names": [field.name for field in cloud.fields],
                "formats": [TYPES[field.type] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_stride,
            }
        )
        points = np.frombuffer(cloud.data, dtype)
        counts |= {(t_ns, int(p["node_id"]), int(p["tactel"])): int(p["counts"]) for p in points}
        assert np.unique(points[["x", "y"]]).size == len(np.unique(points["tactel"]))
    table = pq.read_table(files / "x.parquet").to_pylist()
    assert counts == {(row["t_ns"], row["node_id"], row["tactel"]): row["counts"] for row in table}
    values = [contact for _, message in topics["/contacts/values"] for contact in message["contacts"]]
    assert values == [
        {name: cell for name, cell in row.items() if name not in ("t_ns", "cycle")}
        for row in pq.read_table(files / "x.contacts.parquet").to_pylist()
    ]
    lines = [entity for _, scene in topics["/contacts"] for entity in scene.entities]
    for contact, entity in zip(values, lines, strict=True):
        assert entity.id == f"contact {contact['id']}"
        foot, end = entity.lines[0].points
        assert (foot.x, end.z) == pytest.approx((contact["x_m"], 5e-3 * contact["force_n"]))


def test_a_log_of_another_arm_leaves_what_was_there(field, files, here):
    before = Path(shutil.copy(files / "x.mcap", here)).read_bytes()
    path = changed(here, [format_line(f) for f in frames_in(field) if not 0x181 <= f.can_id <= 0x4FF])
    for args in ((path,), (field, "-c", "can7")):
        said = exported(*args, "--arm", "pad", "--out", "x.mcap", status=1)
        assert "answered a SYNC with readings" in said
    assert Path("x.mcap").read_bytes() == before
    exported(field, "--arm", "pad", "--out", "x.mcap")  # an older export is replaced
