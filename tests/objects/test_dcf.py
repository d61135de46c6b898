"""Configurations: the downloads turn one device into the other; DCF files keep the text they came from."""

from pathlib import Path

import pytest

from skinbus.errors import EdsError
from skinbus.node import Device
from skinbus.objects import cia
from skinbus.objects.dcf import (
    Write,
    configuration,
    dcf_text,
    download_plan,
    to_concise,
    write_dcf,
)
from skinbus.objects.eds import find_eds, load_eds
from skinbus.objects.eds_file import read_text
from skinbus.objects.pdo import Direction, compile_pdo
from skinbus.objects.settings import freeze
from tests.lely import assert_clean
from tests.master.sdo_reads import write

NODE = 5
SOURCE = find_eds("skin-patch").read_text()


def load(path="skin-patch", **values):
    return load_eds(path, NODE, settings=freeze(values))


def differences(od):
    """The variables to which the file gives another value than they have at power-on."""
    every = [v for item in od.values() for v in (item.values() if hasattr(item, "values") else [item])]
    return [v for v in every if v.value is not None and v.value != v.default]


def booted(od):
    device = Device(od, NODE)
    device.step(0)
    return device


def test_nothing_set_is_nothing_to_download():
    assert configuration(load()).writes == ()
    assert differences(load()) == []
    assert (configuration(load()).date, configuration(load()).time) == (0, 0)


def test_plain_values_are_downloaded_in_order_of_index():
    plan = download_plan(load(**{"Noise Pa": 1.0, "Touch Pa": 1500, "Producer heartbeat time": 100}))
    assert plan == [
        (0x1017, 0, b"\x64\x00"),
        (0x2030, 1, b"\xdc\x05\x00\x00"),
        (0x2030, 3, b"\x00\x00\x80\x3f"),
    ]


def test_pdo_is_switched_off_while_it_changes():
    plan = download_plan(load(**{"0x1801:02": 10, "0x1A01:00": 1, "0x1801:01": "$NODEID+0x40000220"}))
    assert plan == [
        (0x1801, 1, (0xC0000285).to_bytes(4, "little")),
        (0x1801, 2, b"\x0a"),
        (0x1A01, 0, b"\x00"),
        (0x1A01, 1, (0x64010510).to_bytes(4, "little")),
        (0x1A01, 0, b"\x01"),
        (0x1801, 1, (0x40000225).to_bytes(4, "little")),
    ]


def test_downloads_turn_a_delivered_patch_into_the_configured_one():
    wanted = load(
        **{
            "Touch Pa": 1234,
            "Tactel gain": [1.0 + k for k in range(16)],
            "0x1800:02": 254,
            "0x1800:05": 40,
            "0x1A01:00": 2,
            "0x1802:01": "$NODEID+0xC0000380",
            "0x1803:01": "$NODEID+0x40000200",
            "0x1400:01": "$NODEID+0x300",
        }
    )
    device = booted(load())
    for entry in download_plan(wanted):
        write(device, *entry).unwrap()
    for variable in differences(wanted):
        assert device.get(variable.index, variable.subindex) == variable.value, variable
    maps = [compile_pdo(load(), Direction.TPDO, n, device.get) for n in (1, 2, 3, 4, 9)]
    assert [(m.cob_id, m.valid, m.length) for m in maps] == [
        (0x185, True, 8),
        (0x285, True, 4),
        (0x385, False, 8),
        (0x205, True, 8),
        (0x505, False, 2),
    ]
    assert (maps[0].transmission_type, maps[0].event_timer_ms) == (254, 40)


def test_simulated_patch_starts_as_delivered_and_with_the_serial_number_expected():
    od = load_eds("skin-patch", NODE, settings=freeze({"Touch Pa": 1500}), serial=77)
    device = booted(od)
    assert device.get(0x2030, 1) == 1000
    assert device.get(cia.IDENTITY, cia.IDENTITY_SERIAL) == 77


def test_marks_tell_what_an_arm_file_sets_on_top_of_a_file_with_marks_of_its_own(tmp_path):
    date, time = ((cia.VERIFY_CONFIGURATION, sub) for sub in (cia.VERIFY_DATE, cia.VERIFY_TIME))
    write_dcf("skin-patch", tmp_path / "own.dcf", {date: 15000, time: 42, (0x2030, 1): 1200})
    as_it_is, changed = (
        configuration(load_eds(tmp_path / "own.dcf", 1, settings=settings))
        for settings in ((), (("Touch Pa", 3000),))
    )
    assert as_it_is.writes != changed.writes
    assert (as_it_is.date, as_it_is.time) != (changed.date, changed.time)
    assert all(write.index != cia.VERIFY_CONFIGURATION for write in as_it_is.writes)


# --- concise DCF

CONCISE = [
    ([], "00000000"),
    ([(0x1017, 0, b"\x64\x00")], "01000000 1710 00 02000000 6400"),
    ([(0x1017, 0, b"\x64\x00"), (0x2030, 1, b"")], "02000000 1710 00 02000000 6400 3020 01 00000000"),
]


@pytest.mark.parametrize(("writes", "data"), CONCISE)
def test_concise_dcf_is_these_bytes(writes, data):
    assert to_concise([Write(*entry) for entry in writes]) == bytes.fromhex(data)


# --- DCF files

VALUES = {(0x2030, 1): 1500, (0x2030, 3): 1.5, (0x1017, 0): 100, (0x2012, 16): -7, (0x1008, 0): "mine"}


def test_dcf_keeps_the_text_and_adds_its_values():
    text = dcf_text(SOURCE, VALUES)
    added = [line for line in text.splitlines() if line.startswith("ParameterValue=")]
    assert len(added) == len(VALUES)
    assert [line for line in text.splitlines() if line not in added] == SOURCE.splitlines()
    file = read_text(text, name="x.dcf")
    assert {key: file.variable(*key).value.number for key in VALUES} == VALUES


def test_dcf_read_back_is_the_configuration(tmp_path):
    path = tmp_path / "left.dcf"
    write_dcf("skin-patch", path, {(0x2030, 1): 1500, (0x1016, 1): 0x7F03E8}, node_id=NODE)
    od = load(path)
    assert [(v.index, v.subindex, v.value) for v in differences(od)] == [
        (0x1016, 1, 0x7F03E8),
        (0x2030, 1, 1500),
    ]
    assert_clean(path, tmp_path)
    text = path.read_text()
    assert "FileName=left.dcf" in text
    assert "LastEDS=skin-patch.eds" in text


@pytest.mark.slow
def test_values_of_compact_arrays_get_a_section_of_their_own(tmp_path):
    path = tmp_path / "master.dcf"
    write_dcf("skin-master", path, {(0x1016, 3): 5, (0x1016, 120): 0x10})
    write_dcf(path, path, {(0x1016, 3): 7, (0x1016, 4): 9})
    assert "[1016Value]\n3=7\nNrOfEntries=3\n120=16\n4=9\n" in path.read_text()
    od = load_eds(path, 127)
    assert [od[0x1016][k].value for k in (2, 3, 4, 120)] == [None, 7, 9, 0x10]
    assert_clean(path, tmp_path)


def test_encoding_and_line_ends_stay_as_they_are(tmp_path):
    source = Path(__file__).parent / "data" / "third-party.eds"
    path = tmp_path / "x.dcf"
    write_dcf(source, path, {(0x1017, 0): 100})
    before, after = source.read_bytes().splitlines(), path.read_bytes().splitlines()
    assert [line for line in after if line not in before] == [
        b"FileName=x.dcf",
        b"LastEDS=third-party.eds",
        b"ParameterValue=100",
    ]
    assert path.read_bytes().count(b"\r\n") == len(after)


def test_every_value_that_does_not_fit_is_said():
    with pytest.raises(EdsError) as caught:
        dcf_text(SOURCE, {(0x2030, 1): -1, (0x2999, 0): 1, (0x1017, 0): 70000})
    assert [str(fault) for fault in caught.value.faults] == [
        "0x2030:01: is -1; wanted a value of type UNSIGNED32",
        "0x2999:00: is 1; wanted an object of the file",
        "0x1017:00: is 70000; wanted a value of type UNSIGNED16",
    ]


def test_synchronous_window_is_held_and_no_part_of_the_marks():
    plain, windowed = configuration(load()), configuration(load(), window_us=20_000)
    assert (windowed.writes, windowed.date, windowed.time) == (plain.writes, plain.date, plain.time)
    assert plain.window is None
    assert windowed.window == Write(cia.SYNC_WINDOW, 0, (20_000).to_bytes(4, "little"))
    assert windowed.window in windowed.communication
    assert windowed.checksum_before == plain.checksum != windowed.checksum
