"""Sweeps, which `warpgrains batch` runs: many runs, in one process or on many machines, and their results."""
