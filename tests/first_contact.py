"""Prints how long a program takes to its first contact, and fails if a kernel had to be compiled for it.

    python tests/first_contact.py

run with an installed wheel, in a process of its own: imports and loading count.
"""

import time

begin = time.monotonic()

import skinbus  # noqa: E402
from skinbus.jit import on_compile, refuse  # noqa: E402


def first_contact():
    """Return where the first contact of a scene came from."""
    with on_compile(refuse), skinbus.simulate("pad") as skin:
        for cycle in skin:
            if cycle.contacts:
                return cycle.level
    raise SystemExit("no contact")


if __name__ == "__main__":
    level = first_contact()
    print(f"{time.monotonic() - begin:.1f} s to the first contact, level {level}, from {skinbus.__file__}")
