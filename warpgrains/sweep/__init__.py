"""Sweeps: many runs, in one process, on many machines, and what came of them."""
