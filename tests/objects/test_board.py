"""What the EDS says of a board's converter: full scale by the width of the readings, steps by its bits."""

import pytest

from skinbus.errors import EdsError
from skinbus.objects.board import describe_patch
from skinbus.objects.eds import find_eds, load_eds
from tests.files import put

EDS = {"skin-patch": "DefaultValue=16", "skin-patch-8bit": "DefaultValue=8"}


def eds_with(folder, name, bits):
    """Return the path of a shipped EDS with another number of bits."""
    head, found, tail = find_eds(name).read_text().partition("ParameterName=Bits")
    return put(
        folder, f"{name}-{bits}.eds", head + found + tail.replace(EDS[name], f"DefaultValue={bits}", 1)
    )


@pytest.mark.parametrize(
    ("name", "bits", "top", "count", "pressure"),
    [
        ("skin-patch", 16, 0x7FFF, 0x7FFF, 250e3),
        ("skin-patch", 12, 0x7FF0, 0x7FFF, 250e3),
        ("skin-patch", 8, 0x7F00, 0x7FFF, 250e3),
        ("skin-patch-8bit", 8, 0x7F, 0x7F, 100e3),
        ("skin-patch-8bit", 12, 0x7F, 0x7F, 100e3),
        ("skin-patch-8bit", 6, 0x7C, 0x7F, 100e3),
    ],
)
def test_count_means_the_same_pressure_whatever_the_bits_of_the_converter(
    tmp_path, name, bits, top, count, pressure
):
    transducer = describe_patch(load_eds(eds_with(tmp_path, name, bits), 1)).transducer
    assert transducer.pressure(count) == pytest.approx(pressure)
    assert transducer.top_counts == top


def test_readings_that_cannot_be_left_adjusted_are_refused(tmp_path):
    text = find_eds("skin-patch").read_text()
    at = text.index("[6401sub10]")
    text = text[:at] + text[at:].replace("DataType=0x0003", "DataType=0x0006", 1)
    with pytest.raises(EdsError, match=r"UNSIGNED16.*INTEGER8 to INTEGER32"):
        describe_patch(load_eds(put(tmp_path, "text.eds", text), 1))
