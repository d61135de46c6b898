"""Inner kernels, which only compiled code can call, for tests in Python."""

from numba import njit


def from_python(inner):
    """Return a function that Python can call and that does what an inner kernel does."""

    @njit
    def outer(*args):
        return inner(*args)

    return outer
