"""Sweeps: many runs, in one process or on many machines, and their results."""
