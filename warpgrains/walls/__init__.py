"""Walls: one file for each kind, motion and joints, and the annulus and the box, which define walls."""
