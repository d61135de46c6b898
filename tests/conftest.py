"""Hypothesis for every test: the same examples on every run, no deadline while kernels compile."""

from hypothesis import settings

settings.register_profile("skinbus", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("skinbus")
