"""Walls: a kind a file, motion and joints, and the annulus and the box that make them."""
