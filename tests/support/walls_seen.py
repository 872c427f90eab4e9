"""Colors of the pixels of a picture at given points of the scene."""

import numpy as np
from scipy.ndimage import label

from warpgrains.drawing.shapes import WALL_COLOR


class View:
    """Map from points of a scene [m] to pixels of its picture.

    It is found from the pixels that have the color of walls: the outer wall, which has a radius of 2 m.
    """

    def __init__(self, pixels, atol=0.02):
        shape, _ = label(np.abs(pixels - WALL_COLOR).max(axis=2) < atol, np.ones((3, 3)))
        row, column = np.nonzero(shape == 1 + np.argmax(np.bincount(shape.ravel())[1:]))
        width = np.ptp(column) + 1
        self._corner = np.array([column.min() + width / 2.0, row.min() + (np.ptp(row) + 1) / 2.0])
        # half of the pixel at each end is not found as the wall, whose thickness follows the view
        self.scale = (width + 1.0) / (2.0 * (2.0 + 0.014 * 1.04 * 2.0))
        """Pixels per meter."""

    def at(self, pixels, places):
        """Return the colors of the pixels at the points `places` of the scene [m], shape (n, 2)."""
        column, row = (self._corner + self.scale * np.array([1.0, -1.0]) * places).astype(int).T
        return pixels[row, column]
