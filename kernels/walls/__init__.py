"""Walls: contacts of grains with each kind of wall, and the motion of walls."""
