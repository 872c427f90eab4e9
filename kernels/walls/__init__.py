"""Walls: where a grain touches each kind, and how walls move."""
