"""`skinbus export`: what other readers find in the files is what was on the bus, value by value."""

import csv
import json
import os
from pathlib import Path

import cantools
import numpy as np
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner
from foxglove_schemas_protobuf import FrameTransforms_pb2, PointCloud_pb2, SceneUpdate_pb2
from mcap.reader import make_reader

from skinbus.can.candump import CandumpReader, CandumpWriter, format_line
from skinbus.can.frame import Frame
from skinbus.cli import group
from tests.cli.commands.wall_clock import WallClock
from tests.master.buses_rig import ON_SEAM, BusesRig, write_scene
from tests.master.rig import Rig

MASTER_IDS = {0x681 + k for k in range(16)}


@pytest.fixture(scope="module")
def field(tmp_path_factory):
    """Two seconds of the scene pad, from the boot on."""
    path = tmp_path_factory.mktemp("field") / "field.log"
    rig = Rig("pad", level="fit")
    with CandumpWriter(path, clock=WallClock()) as writer:
        rig.wire.tap(writer)
        rig.run(2000.0)
    return path


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """A log of two buses with a press on their seam, and its arm file."""
    folder = tmp_path_factory.mktemp("both")
    rig = BusesRig(write_scene(folder, [ON_SEAM]))
    path = folder / "both.log"
    with CandumpWriter(path, clock=WallClock(), channels=("can0", "can1")) as writer:
        for bus, wire in enumerate(rig.wires.wires):
            wire.tap(lambda frame, bus=bus: writer.write([frame._replace(bus=bus)]))
        rig.run(1000.0)
    return path, folder / "arm.toml"


def export(*args):
    return CliRunner().invoke(group, ["export", *map(str, args)])


def exported(*args):
    result = export(*args)
    assert result.exit_code == 0, result.output
    return result.output


def frames_of(path, channel="can0"):
    return [frame for frame, name in CandumpReader(path) if name == channel]


def decoded_by_cantools(arm, folder, frames, bus=""):
    """Every reading of the frames, as cantools makes it of the DBC: time, node, tactel, Pa."""
    os.chdir(folder)
    exported("dbc", arm)
    (path,) = folder.glob(f"*{bus}.dbc")
    database = cantools.database.load_file(path)
    known = {message.frame_id: message for message in database.messages if "patch" in message.senders[0]}
    rows = []
    for frame in frames:
        if message := known.get(frame.can_id):
            node = int(message.senders[0].removeprefix("patch_"))
            for name, value in message.decode(frame.data).items():
                rows.append((frame.t_ns, node, int(name.removeprefix("tactel_")), value))
    return rows


@pytest.fixture
def here(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_parquet_holds_every_reading_of_every_frame(field, here):
    said = exported(field, "--arm", "pad", "--out", "x.parquet")
    table = pq.read_table("x.parquet").to_pydict()
    expected = decoded_by_cantools("pad", here, frames_of(field))
    assert len(expected) > 1000
    assert f"{len(expected)} readings" in said
    names = ("t_ns", "node_id", "tactel", "pressure_pa")
    for row, other in zip(zip(*(table[name] for name in names), strict=True), expected, strict=True):
        assert row[:3] == other[:3]
        assert row[3] == pytest.approx(other[3], rel=1e-9, abs=1e-6)
    syncs = sorted(frame.t_ns for frame in frames_of(field) if frame.can_id == 0x80)
    assert table["cycle"] == np.searchsorted(syncs, table["t_ns"], "right").tolist()
    assert set(table["link"]) == {"plate"}


def check_published(table, frames):
    """Contacts of a table against the bytes of the TPDOs."""
    expected = [frame for frame in frames if frame.can_id in MASTER_IDS and frame.data[1] >> 4]
    rows = [row for row in table if row["source"] == "published"]
    assert len(rows) == len(expected) > 20
    words = ["none", "touch", "held", "lift", "coast"]
    for row, frame in zip(rows, expected, strict=True):
        assert row["t_ns"] == frame.t_ns
        assert row["id"] == frame.data[0]
        assert row["state"] == words[frame.data[1] >> 4]
        assert round(1e4 * row["s_m"]) == int.from_bytes(frame.data[2:4], "little", signed=True)
        assert round(1e4 * row["a_m"]) == int.from_bytes(frame.data[4:6], "little", signed=True)
        assert round(1e2 * row["force_n"]) == int.from_bytes(frame.data[6:8], "little")
        assert row["quality"] is row["level"] is row["cov_s_s"] is row["identity"] is None


@pytest.mark.slow
def test_parquet_says_which_contacts_were_published_and_which_recomputed(field, here):
    exported(field, "--arm", "pad", "--out", "x.parquet", "--recompute", "fit")
    table = pq.read_table("x.contacts.parquet").to_pylist()
    check_published(table, frames_of(field))
    again = [row for row in table if row["source"] == "recomputed"]
    run = CliRunner().invoke(group, ["replay", str(field), "--arm", "pad", "--out", "replay.csv"])
    assert run.exit_code == 0
    expected = list(csv.DictReader(Path("replay.csv").read_text().splitlines()))
    assert len(again) == len(expected) > 20
    for row, other in zip(again, expected, strict=True):
        assert f"{row['t_ns'] / 1e9:.3f}" == f"{float(other['time']):.3f}"
        assert (row["id"], row["link"]) == (int(other["id"]), other["link"])
        assert f"{1e3 * row['s_m']:.2f}" == other["s_mm"]
        if other["quality"]:
            assert (row["quality"], row["level"]) == (other["quality"], other["level"])
            assert row["cov_s_s"] > 0.0
            assert row["x_m"] == pytest.approx(row["s_m"])


@pytest.mark.slow
def test_pressures_less_the_zeros_are_those_of_the_master(field, here):
    exported(field, "--arm", "pad", "--out", "x.parquet", "--recompute", "kmeans")
    table = pq.read_table("x.parquet")
    zeroed, raw = table["zeroed_pa"].to_numpy(), table["pressure_pa"].to_numpy()
    used = ~np.isnan(zeroed)
    assert used.mean() > 0.9
    # the zero of a tactel hardly moves while it is touched: what is taken off is the same from cycle to cycle
    tactel = table["tactel"].to_numpy()
    for k in np.unique(tactel):
        taken = (raw - zeroed)[used & (tactel == k)]
        assert np.ptp(taken[5:]) < 0.2 * (raw.max() - raw.min())
    assert zeroed[used].max() > 1000.0


KINDS = {
    "foxglove.PointCloud": PointCloud_pb2.PointCloud,
    "foxglove.SceneUpdate": SceneUpdate_pb2.SceneUpdate,
    "foxglove.FrameTransforms": FrameTransforms_pb2.FrameTransforms,
}
"""Foxglove's own description of its messages."""


def messages_of(path):
    with open(path, "rb") as file:
        found = {}
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if schema.name.startswith("foxglove."):
                assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
                content = KINDS[schema.name].FromString(message.data)
            else:
                assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
                assert json.loads(schema.data)["title"] == schema.name
                content = json.loads(message.data)
            found.setdefault(channel.topic, []).append((schema.name, message.log_time, content))
        return found


def test_mcap_holds_every_reading_and_every_contact_in_messages_that_foxglove_knows(field, here):
    exported(field, "--arm", "pad", "--out", "x.mcap")
    topics = messages_of("x.mcap")
    expected = decoded_by_cantools("pad", here, frames_of(field))
    found = []
    for _, _, cloud in topics["/pressures/plate"]:
        fields = {field.name: (field.type, field.offset) for field in cloud.fields}
        types = {1: "u1", 6: "<i4", 7: "<f4"}
        dtype = np.dtype(
            {
                "names": list(fields),
                "formats": [types[kind] for kind, _ in fields.values()],
                "offsets": [offset for _, offset in fields.values()],
                "itemsize": cloud.point_stride,
            }
        )
        points = np.frombuffer(cloud.data, dtype)
        found += [(int(p["node_id"]), int(p["tactel"]), float(p["pressure"])) for p in points]
        assert np.unique(points[["x", "y"]]).size == len(np.unique(points["tactel"]))
    assert len(found) == len(expected)
    for row, (_, node, tactel, pressure) in zip(found, expected, strict=True):
        assert row[:2] == (node, tactel)
        assert row[2] == pytest.approx(pressure, rel=1e-6, abs=1e-3)
    rows = [
        {
            **{
                key: contact[key]
                for key in ("t_ns", "id", "state", "s_m", "a_m", "force_n", "quality", "level", "identity")
            },
            "source": "published",
            "cov_s_s": contact["covariance"],
        }
        for _, _, message in topics["/contacts/published/values"]
        for contact in message["contacts"]
    ]
    check_published(rows, frames_of(field))
    for scene, values in zip(
        topics["/contacts/published"], topics["/contacts/published/values"], strict=True
    ):
        shown = {entity.id: entity for entity in scene[2].entities}
        assert list(shown) == [f"contact {contact['id']}" for contact in values[2]["contacts"]]
        for contact in values[2]["contacts"]:
            arrow = shown[f"contact {contact['id']}"].arrows[0]
            length = arrow.shaft_length + arrow.head_length
            assert arrow.pose.position.z == pytest.approx(contact["point_m"]["z"] + length)
    assert {entity.id for entity in topics["/arm"][0][2].entities} == {"link plate"}


def test_mcap_has_recomputed_contacts_beside_the_published_ones(field, here):
    exported(field, "--arm", "pad", "--out", "x.mcap", "--recompute", "fit")
    topics = messages_of("x.mcap")
    n = {source: len(topics[f"/contacts/{source}"]) for source in ("published", "recomputed")}
    assert n["recomputed"] >= n["published"] > 50
    contacts = [c for _, _, m in topics["/contacts/recomputed/values"] for c in m["contacts"]]
    assert any(contact["covariance"] and contact["identity"] for contact in contacts)


def test_an_arm_of_two_buses_has_a_dbc_for_each_and_all_its_readings(both, here):
    log, arm = both
    exported(log, "--arm", arm, "-c", "left=can0", "-c", "right=can1", "--out", "x.parquet")
    table = pq.read_table("x.parquet").to_pydict()
    for bus, channel in (("left", "can0"), ("right", "can1")):
        expected = decoded_by_cantools(arm, here, frames_of(log, channel), f"-{bus}")
        columns = (table[name] for name in ("bus", "t_ns", "node_id", "tactel"))
        mine = [row[1:] for row in zip(*columns, strict=True) if row[0] == bus]
        assert mine == [row[:3] for row in expected]
        assert len(mine) > 300


@pytest.mark.slow
def test_a_log_without_sync_has_cycles_too(field, here):
    lines = [format_line(frame) for frame in frames_of(field) if frame.can_id != 0x80]
    Path("still.log").write_text("".join(f"{line}\n" for line in lines))
    exported("still.log", "--arm", "pad", "--out", "x.parquet", "--recompute", "kmeans")
    table = pq.read_table("x.parquet")
    n_syncs = sum(frame.can_id == 0x80 for frame in frames_of(field))
    assert abs(int(table["cycle"].to_numpy().max()) - n_syncs) < 10
    assert np.isfinite(table["zeroed_pa"].to_numpy()).mean() > 0.5


def test_a_tpdo_that_came_twice_in_a_cycle_has_no_pressure_that_might_be_of_the_other(field, here):
    frames = frames_of(field)
    k = next(k for k in range(len(frames) // 2, len(frames)) if frames[k].can_id == 0x181)
    twin = frames[k]._replace(data=bytes(8), t_ns=frames[k].t_ns + 1000)
    lines = [format_line(frame) for frame in [*frames[: k + 1], twin, *frames[k + 1 :]]]
    Path("twice.log").write_text("".join(f"{line}\n" for line in lines))
    exported("twice.log", "--arm", "pad", "--out", "x.parquet", "--recompute", "kmeans")
    table = pq.read_table("x.parquet").to_pylist()
    both = [row for row in table if row["t_ns"] in (frames[k].t_ns, twin.t_ns) and row["tactel"] <= 4]
    assert len(both) == 8
    assert all(row["zeroed_pa"] is None for row in both)


def test_hostile_frames_of_a_master_are_exported_as_they_are(field, here):
    frames = frames_of(field)
    odd = Frame(0x681, bytes([7, 0x9E, 1, 0, 2, 0, 3, 0]), frames[-1].t_ns)
    lines = [format_line(frame) for frame in [*frames, odd]]
    Path("odd.log").write_text("".join(f"{line}\n" for line in lines))
    exported("odd.log", "--arm", "pad", "--out", "x.parquet")
    row = pq.read_table("x.contacts.parquet").to_pylist()[-1]
    assert (row["state"], row["link"], row["x_m"]) == ("9", "14", None)
    exported("odd.log", "--arm", "pad", "--out", "x.mcap")


def test_what_is_wrong_is_refused_and_nothing_is_written_over(field, here):
    Path("notes.mcap").write_text("mine")
    Path("field.mcap").write_bytes(field.read_bytes())
    Path("link.mcap").symlink_to("elsewhere.mcap")
    Path("empty.log").write_text("")
    for args, said in (
        ((field, "--arm", "pad"), "--out"),
        ((field, "--arm", "pad", "--out", "x.csv"), ".mcap"),
        ((field, "--out", "x.mcap"), "--arm"),
        ((field, "--arm", "nobody", "--out", "x.mcap"), "nobody"),
        ((field, "--arm", "pad", "--out", "x.mcap", "--node-id", "1"), "node-id"),
        ((field, "--arm", "pad", "--out", "x.mcap", "--zero"), "--recompute"),
        ((field, "--arm", "pad", "--out", "notes.mcap"), "would be lost"),
        ((field, "--arm", "pad", "--out", "link.mcap"), "symbolic link"),
        ((field, "--arm", "pad", "--out", "no/such/x.mcap"), "cannot write"),
        ((field, "--out", "x.pcap"), ".mcap"),
        (("field.mcap", "--arm", "pad", "--out", "field.mcap"), "input"),
        (("absent.log", "--arm", "pad", "--out", "x.mcap"), "No such file"),
        (("empty.log", "--arm", "pad", "--out", "x.mcap"), "empty"),
        ((field, "pad", "--out", "x.mcap"), "unexpected"),
        (("dbc",), "dbc ARM"),
        (("dbc", "pad", "--out", "x.txt"), ".dbc"),
        (("dbc", "pad", "--recompute", "fit"), "dbc ARM"),
    ):
        result = export(*args)
        text = result.output + str(result.exception or "")
        assert result.exit_code in (1, 2), args  # files that are wrong raise, and main makes them 2
        assert result.exit_code == 2 or type(result.exception).__name__ == "ConfigError", args
        assert said in text, (args, text)
    assert Path("notes.mcap").read_text() == "mine"
    assert Path("field.mcap").read_bytes() == field.read_bytes()
    assert {path.name for path in here.iterdir()} == {"notes.mcap", "field.mcap", "link.mcap", "empty.log"}


def test_a_log_of_another_arm_leaves_what_was_there(field, here):
    exported(field, "--arm", "pad", "--out", "x.mcap")
    before = Path("x.mcap").read_bytes()
    lines = [format_line(f) for f in frames_of(field) if not 0x181 <= f.can_id <= 0x4FF]
    Path("other.log").write_text("".join(f"{line}\n" for line in lines))
    for args in (("other.log",), (field, "-c", "can7")):
        result = export(*args, "--arm", "pad", "--out", "x.mcap")
        assert result.exit_code == 1
        assert "sent readings" in result.output
    assert Path("x.mcap").read_bytes() == before
    exported(field, "--arm", "pad", "--out", "x.mcap")  # an older export is replaced
