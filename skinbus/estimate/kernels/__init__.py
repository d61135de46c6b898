"""Kernels that all levels share: array tables, layout, workspace, geometry, law, places, offsets."""
