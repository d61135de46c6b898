"""DBC files: cantools decodes every PDO of every kind of board to what we unpack, in the units they say."""

import math
import random

import cantools
import pytest

from skinbus.cli.export.dbc import Device, dbc
from skinbus.objects.eds import load_eds
from skinbus.objects.pdo import carries_readings, tpdos

BOARDS = ["skin-patch", "skin-patch-8bit", "skin-patch-8x8", "skin-patch-fd", "skin-patch-fd32"]


def database(*devices, **settings):
    text = dbc(devices, **settings)
    assert text.isascii()
    return cantools.database.load_string(text, "dbc", strict=True)


def device(name, node_id=5, **settings):
    od = load_eds(name, node_id)
    return Device(settings.pop("called", f"patch_{node_id}"), od, **settings)


@pytest.mark.parametrize("name", BOARDS)
def test_readings_of_every_board_come_out_by_tactel_in_pascals(name):
    rng = random.Random(f"dbc {name}")
    scales = {k: (rng.uniform(0.5, 9.0), rng.uniform(-500.0, 500.0)) for k in range(1, 65)}
    board = device(name, readings=scales)
    found = database(board, is_fd=True)
    n_readings = 0
    for pdo in filter(carries_readings, tpdos(board.od)):
        message = found.get_message_by_frame_id(pdo.cob_id)
        assert (message.length, message.is_fd) == (pdo.length, pdo.length > 8)
        assert message.senders == ["patch_5"]
        data = rng.randbytes(pdo.length)
        values = message.decode(data, decode_choices=False)
        whole = int.from_bytes(data, "little")
        for entry in pdo.entries:
            if entry.index not in (0x6400, 0x6401):
                continue
            raw = whole >> entry.offset & ((1 << entry.bits) - 1)
            raw -= (raw >> (entry.bits - 1)) << entry.bits
            factor, offset = scales[entry.sub]
            expected = raw * factor + offset
            assert math.isclose(values[f"tactel_{entry.sub}"], expected, rel_tol=1e-12, abs_tol=1e-9)
            signal = message.get_signal_by_name(f"tactel_{entry.sub}")
            assert (signal.unit, signal.comment) == ("Pa", f"0x{entry.index:04X}:{entry.sub:02X}")
            n_readings += 1
    assert n_readings == {"skin-patch-8x8": 64, "skin-patch-fd32": 32}.get(name, 16)


def test_contacts_have_links_states_and_units():
    master = device("skin-master", 127, called="master", links=["upper arm", 'fore"arm'])
    found = database(master)
    message = found.get_message_by_name("master_Contact_3")
    assert message.frame_id == 0x683
    values = message.decode(bytes([9, 0x21, 0x10, 0x27, 0xF0, 0xD8, 0x39, 0x05]))
    assert (values["Id"], str(values["link"]), str(values["state"])) == (9, "fore'arm", "held")
    assert [values[name] for name in ("s", "a", "Force")] == pytest.approx([1000.0, -1000.0, 13.37], abs=1e-9)
    units = [message.get_signal_by_name(name).unit for name in ("s", "a", "Force")]
    assert units == ["mm", "mm", "N"]
    (summary,) = (m for m in found.messages if m.frame_id == 0x1FF)
    values = summary.decode(bytes([1, 2, 3, 0, 0x10, 0x27, 0x64, 0]))
    assert (values["Compute_time"], values["Latency"]) == (10_000, 1000)
    doubt = found.get_message_by_name("master_Contact_3_Quality")
    values = doubt.decode(bytes([8, 15, 255, 9, 0x21]))
    assert (doubt.frame_id, values["Quality"], values["Id"]) == (0x6A3, 8, 9)
    assert [values["Place_sd"], values["Force_sd"]] == pytest.approx([1.5, 12.75])
