"""Geometry of discs and regions in the plane."""
