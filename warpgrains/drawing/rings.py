"""The walls as they are drawn: flat rings about the origin."""

from warpgrains.scene.walls import Annulus

WALL_COLOR = (0.35, 0.35, 0.35)
"""sRGB."""

_THICKNESS = 0.02  # of radius_out


def rings(walls: Annulus) -> dict[str, tuple[float, float]]:
    """Return inner and outer radius of each wall [m], outside the space that they leave to the grains."""
    radius_in, radius_out = walls.radius_in, walls.radius_out
    thickness = _THICKNESS * radius_out
    drawn = {"Outer": (radius_out, radius_out + thickness)}
    if radius_in > 0:
        drawn["Inner"] = (max(radius_in - thickness, radius_in / 2), radius_in)
    return drawn
