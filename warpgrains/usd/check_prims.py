"""What must hold for the prims of a recording, in every frame."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

Values = NDArray[Any]


class GrainsInspector:
    """Checks the grains, be they points or instances of a sphere.

    Parameters
    ----------
    prim : Usd.Prim
        `UsdGeom.Points` or `UsdGeom.PointInstancer`.

    Attributes
    ----------
    position : Usd.Attribute
        Where the grains are, frame by frame.
    animated : list of Usd.Attribute
        What must have the same time codes.
    """

    def __init__(self, prim: Usd.Prim) -> None:
        self._are_points = prim.IsA(UsdGeom.Points)
        self.position = prim.GetAttribute("points" if self._are_points else "positions")
        self._size = prim.GetAttribute("widths" if self._are_points else "scales")
        self._velocities = prim.GetAttribute("velocities")
        self._extent = prim.GetAttribute("extent")
        self._ids = prim.GetAttribute("ids")
        self._color = UsdGeom.PrimvarsAPI(prim).GetPrimvar("displayColor")
        self.animated = [self._velocities, self._extent]
        if self._color.GetAttr().GetNumTimeSamples():
            self.animated.append(self._color.GetAttr())

    def static_problems(self) -> Iterator[str]:
        """Yield what is wrong with what no frame may change."""
        ids, size = _values(self._ids), _values(self._size)
        if ids is not None and len(np.unique(ids)) != len(ids):
            yield f"ids are not unique: {len(ids) - len(np.unique(ids))} of {len(ids)} repeat another"
        if size is not None and not (np.isfinite(size) & (size > 0)).all():
            yield f"{self._size.GetName()} are not all positive and finite"
        for attribute in (self._ids, self._size):
            if attribute.GetNumTimeSamples():
                yield f"{attribute.GetName()} change with time"

    def frame_problems(self, code: float) -> Iterator[str]:
        """Yield what is wrong with the frame at time code `code`."""
        position = _values(self.position, code)
        if position is None or len(position) == 0:
            yield f"{self.position.GetName()} are empty"
            return
        for attribute in (self.position, self._velocities, self._color.GetAttr()):
            yield from _finite_problems(attribute, code)
        yield from self._length_problems(len(position), code)
        size = _values(self._size, code)
        if size is not None and len(size) in (1, len(position)):
            half_width = size / 2.0 if self._are_points else size[:, 0]
            yield from _extent_problems(self._extent, position, half_width, code)

    def _length_problems(self, grains: int, code: float) -> Iterator[str]:
        expected = {self._velocities: grains, self._ids: grains, self._size: grains}
        if self._are_points and UsdGeom.Points(self._size.GetPrim()).GetWidthsInterpolation() == "constant":
            expected[self._size] = 1
        expected[self._color.GetAttr()] = 1 if self._color.GetInterpolation() == "constant" else grains
        if not self._are_points:
            expected[self._size.GetPrim().GetAttribute("protoIndices")] = grains
        for attribute, length in expected.items():
            yield from _length_problem(attribute, length, f"{grains} grains", code)


class ForcesInspector:
    """Checks the force chains.

    Parameters
    ----------
    prim : Usd.Prim
        `UsdGeom.BasisCurves` of two points each.

    Attributes
    ----------
    animated : list of Usd.Attribute
        What must have the time codes of the grains.
    """

    def __init__(self, prim: Usd.Prim) -> None:
        names = ("points", "curveVertexCounts", "widths", "extent")
        self.animated = [prim.GetAttribute(name) for name in names]

    def frame_problems(self, code: float) -> Iterator[str]:
        """Yield what is wrong with the frame at time code `code`."""
        points, counts, widths, extent = self.animated
        ends, vertices, width = (_values(attribute, code) for attribute in (points, counts, widths))
        if ends is None or vertices is None or width is None:
            yield "force chains lack a value"
            return
        yield from _length_problem(points, int(vertices.sum()), f"{len(vertices)} segments", code)
        yield from _length_problem(widths, len(ends), f"{len(ends)} points", code)
        yield from _finite_problems(points, code)
        yield from _finite_problems(widths, code)
        if len(ends) and len(width) == len(ends):
            yield from _extent_problems(extent, ends, width / 2.0, code)


def _finite_problems(attribute: Usd.Attribute, code: float) -> Iterator[str]:
    values = _values(attribute, code)
    if values is not None and not np.isfinite(values).all():
        yield f"{attribute.GetName()} are not all finite"


def _length_problem(attribute: Usd.Attribute, length: int, reason: str, code: float) -> Iterator[str]:
    values = _values(attribute, code)
    found = 0 if values is None else len(values)
    if found != length:
        yield f"{attribute.GetName()} hold {found} values, not {length} for {reason}"


def _extent_problems(
    attribute: Usd.Attribute, places: Values, half_width: Values, code: float
) -> Iterator[str]:
    extent = _values(attribute, code)
    if extent is None or extent.shape != (2, 3):
        yield "extent is not two corners"
        return
    centre, reach = places.astype(np.float64), half_width.astype(np.float64)[:, np.newaxis]
    if ((centre - reach < extent[0]) | (centre + reach > extent[1])).any():
        yield "extent does not cover what it bounds"


def _values(attribute: Usd.Attribute, code: float = 0.0) -> Values | None:
    """Return the value at a time code as an array, None where there is none."""
    value = attribute.Get(code)
    return None if value is None else np.array(value)
