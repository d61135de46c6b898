"""Codes of CiA 301 in words."""

import pytest

from skinbus.objects.cia import describe_abort, describe_emcy


def test_an_abort_code_says_what_it_means():
    assert describe_abort(0x06090011) == "0x06090011 (Subindex does not exist)"
    assert "unknown" in describe_abort(0x12345678)


@pytest.mark.parametrize(
    ("code", "data", "words"),
    [
        (0x8100, b"\x07\x10\0\0\0", "synchronous window missed"),
        (0x8100, bytes(5), "communication"),
        (0x8120, b"", "CAN error passive"),
        (0x3110, b"", "supply voltage"),
        (0x4205, b"", "temperature of the device"),
        (0x5012, b"", "hardware"),
        (0xC000, b"", "unknown"),
    ],
)
def test_emcy_is_said_in_words(code, data, words):
    assert describe_emcy(code, data).startswith(f"0x{code:04X} ({words}")
