"""A function in a process of its own: for tests that measure the process, which others have used before."""

from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

T = TypeVar("T")


def run_in_process(function, *args):
    """Return what a function of a module makes of its arguments in a fresh process; raise what it raises."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        return pool.submit(function, *args).result()
