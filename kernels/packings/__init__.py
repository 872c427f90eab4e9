"""Kernels of packings: random placement of grains, and removal of overlaps."""
