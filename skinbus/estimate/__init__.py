"""Pressures to contacts: pure functions on arrays, kernels compiled by numba."""
