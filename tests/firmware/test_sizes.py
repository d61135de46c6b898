"""The C on microcontrollers: it compiles for Cortex-M0+ and M4 without a warning, and stays small."""

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from skinbus.firmware import write_project
from tests.firmware.firmware_device import WARNINGS

FLASH, RAM = 20_000, 6_000
"""Bytes for 16 tactels, with a port."""


def lacks(what):
    """Skip a test, but not in CI, which installs what is needed: 100 MB are too many for everybody."""
    (pytest.fail if os.environ.get("CI") else pytest.skip)(f"needs {what}")


def compiler(cpu):
    """Return the words that begin a command of a cross compiler, of which one is enough."""
    if gcc := shutil.which("arm-none-eabi-gcc"):
        return [gcc, f"-mcpu={cpu}", "-mthumb"]
    if not (zig := find_spec("ziglang")):
        lacks("arm-none-eabi-gcc, or: pip install ziglang")
    headers = Path(zig.origin).parent / "lib" / "libc" / "include"
    target = ("-target", "thumb-freestanding-eabi", f"-mcpu={cpu.replace('-', '_')}")
    places = [f"-isystem{headers / name}" for name in ("generic-musl", "arm-linux-musl")]
    return [sys.executable, "-m", "ziglang", "cc", *target, *places]


@pytest.mark.slow
@pytest.mark.parametrize("cpu", ["cortex-m0plus", "cortex-m4"])
def test_firmware_for_a_microcontroller_is_small(tmp_path, cpu):
    command = compiler(cpu)
    write_project("skin-patch", tmp_path)
    sources = [*tmp_path.glob("core/*.c"), tmp_path / "board.c", tmp_path / "ports" / "stm32f072.c"]
    flags = [
        *WARNINGS,
        "-Wno-unused-parameter",
        "-Os",
        "-ffreestanding",
        "-DSB_PROGRAM_BYTES=0x8800",
        f"-I{tmp_path}",
        f"-I{tmp_path / 'core'}",
        "-c",
    ]
    built = subprocess.run([*command, *flags, *sources], cwd=tmp_path, capture_output=True, text=True)
    assert (built.returncode, built.stderr) == (0, "")
    sizes = subprocess.run(["size", "-t", *tmp_path.glob("*.o")], check=True, capture_output=True, text=True)
    text, data, bss = map(int, sizes.stdout.splitlines()[-1].split()[:3])
    print(f"{cpu}: flash {text + data}, RAM {data + bss} bytes")
    assert text + data < FLASH
    assert data + bss < RAM
