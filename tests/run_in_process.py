"""A function in a process of its own: for tests that measure the process, which others have used before."""

import subprocess
import sys
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

T = TypeVar("T")


def run_in_process(function, *args):
    """Return what a function of a module makes of its arguments in a fresh process; raise what it raises."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *args).result()


def run_code(code):
    """Return what code prints in a fresh process, without the last line end."""
    return subprocess.check_output([sys.executable, "-c", code], text=True).rstrip()
