"""Checks of a recording beyond those of USD validators."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from warpgrains.usd.forces import FORCES, GRAINS_OF, TANGENTIAL
from warpgrains.usd.grains import (
    COLOR_INDICES,
    GRAINS,
    OF_GRAINS,
    ORIENTATIONS,
    VELOCITIES,
    numbers_of,
    position_of,
    quaternions,
)
from warpgrains.usd.reader import open_recording, refusing_untrusted_content
from warpgrains.usd.stage import Values, too_coarse, values_of
from warpgrains.usd.walls import PLACES, WALLS

_HALF = 1e-3  # of a quaternion: half precision, and angles as float32 up to 1e4 rad


def inspect_recording(path: str | Path) -> list[str]:
    """Return the problems of a recording, one line each; the list is empty if there are none.

    Raises
    ------
    InputError
        The file is missing, is not USD, or has content that recordings do not have. Only the command
        ``warpgrains check`` is safe against files that crash USD or never end.
    """
    with refusing_untrusted_content(path):
        return _problems(open_recording(Path(path)))


def report_on_recording(path: str | Path) -> list[str]:
    """Return the lines that `check` prints: the problems of a recording, or else "OK" and its size."""
    with refusing_untrusted_content(path):
        stage = open_recording(Path(path))
        return _problems(stage) or [_size(stage)]


def _size(stage: Usd.Stage) -> str:
    position = GrainsInspector(stage.GetPrimAtPath(GRAINS)).position
    codes = position.GetTimeSamples()
    return f"OK: {len(codes)} frames, {_length(position, codes[0])} grains"


def _problems(stage: Usd.Stage) -> list[str]:
    problems = list(_stage_problems(stage))
    prim = stage.GetPrimAtPath(GRAINS)
    if not (prim and (prim.IsA(UsdGeom.Points) or prim.IsA(UsdGeom.PointInstancer))):
        return [*problems, f"no UsdGeom.Points or PointInstancer at {GRAINS}"]
    grains = GrainsInspector(prim)
    codes = grains.position.GetTimeSamples()
    problems += [*_code_problems(stage, codes), *grains.static_problems()]
    problems += _wall_problems(stage, codes)
    drawn: list[GrainsInspector | ForcesInspector] = [grains]
    if stage.GetPrimAtPath(FORCES):
        drawn.append(ForcesInspector(stage.GetPrimAtPath(FORCES)))
    for inspector in drawn:
        for attribute in inspector.animated:
            if attribute.GetTimeSamples() != codes:
                place = f"{attribute.GetPrim().GetName()}.{attribute.GetName()}"
                problems.append(f"{place} has other time codes than the grains' positions")
        problems += _by_frame(inspector.frame_problems, codes)
    return problems


def _stage_problems(stage: Usd.Stage) -> Iterator[str]:
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.y:
        yield f"upAxis is {UsdGeom.GetStageUpAxis(stage)}, not Y"
    if UsdGeom.GetStageMetersPerUnit(stage) != 1.0:
        yield f"metersPerUnit is {UsdGeom.GetStageMetersPerUnit(stage)}, not 1"
    if not UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage):
        yield "kilogramsPerUnit is missing"
    if not stage.GetDefaultPrim():
        yield "defaultPrim is missing"
    if stage.GetTimeCodesPerSecond() != stage.GetFramesPerSecond():
        yield (
            f"timeCodesPerSecond {stage.GetTimeCodesPerSecond():g} differs "
            f"from framesPerSecond {stage.GetFramesPerSecond():g}"
        )


def _code_problems(stage: Usd.Stage, codes: list[float]) -> Iterator[str]:
    if not codes:
        yield "the grains have no time samples"
        return
    if codes != list(range(len(codes))):
        yield "the time codes of the grains are not 0, 1, 2, ..."
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if (start, end) != (codes[0], codes[-1]):
        frames = f"{codes[0]:g} to {codes[-1]:g}"
        yield f"startTimeCode and endTimeCode are {start:g} and {end:g}, but the frames are {frames}"


def _wall_problems(stage: Usd.Stage, codes: list[float]) -> Iterator[str]:
    """Yield the walls that move at other times than the grains, or to places that are not finite."""
    walls = stage.GetPrimAtPath(WALLS)
    if not walls:
        return
    points = [wall.GetAttribute("points") for wall in walls.GetChildren()]
    places = walls.GetAttribute(PLACES)
    for attribute in (*points, *([places] if places else [])):
        samples = attribute.GetTimeSamples()
        if samples and samples != codes:
            name = f"{attribute.GetPrim().GetName()}.{attribute.GetName()}"
            yield f"{name} has other time codes than the grains' positions"
        for code in samples or [0.0]:
            yield from _finite_problems(attribute, code)


def _by_frame(problems_of: Callable[[float], Iterator[str]], codes: list[float]) -> Iterator[str]:
    """Yield each problem once, with its first frame and the number of other frames."""
    found: dict[str, list[float]] = {}
    for code in codes:
        for problem in problems_of(code):
            found.setdefault(problem, []).append(code)
    for problem, where in found.items():
        others = f" and {len(where) - 1} more" if len(where) > 1 else ""
        yield f"{problem} (frame {where[0]:g}{others})"


class GrainsInspector:
    """Checks of the grains, which are `UsdGeom.Points` or a `UsdGeom.PointInstancer`.

    All `animated` attributes must have the time codes of `position`.
    """

    def __init__(self, prim: Usd.Prim) -> None:
        self._are_points = prim.IsA(UsdGeom.Points)
        self.position = position_of(prim)
        self._size = prim.GetAttribute("widths" if self._are_points else "scales")
        self._extent = prim.GetAttribute("extent")
        self._ids = prim.GetAttribute("ids")
        table = prim.GetAttribute("primvars:displayColor")
        self._table_of = {prim.GetAttribute(COLOR_INDICES): _length(table)}
        if not self._are_points:
            prototypes = UsdGeom.PointInstancer(prim).GetPrototypesRel().GetTargets()
            self._table_of[prim.GetAttribute("protoIndices")] = len(prototypes)
        values = numbers_of(prim).values()
        self._orientations = prim.GetAttribute(ORIENTATIONS)
        self._angle = prim.GetAttribute("primvars:angle")
        turned = [self._orientations] if self._orientations.HasAuthoredValue() else []
        exact = [prim.GetAttribute(name) for name in OF_GRAINS.values()]
        self._values = [prim.GetAttribute(VELOCITIES), *self._table_of, *values, *exact, *turned]
        changing = [attribute for attribute in self._values if attribute.GetNumTimeSamples()]
        self.animated = [self._extent, *changing]

    def static_problems(self) -> Iterator[str]:
        """Yield the problems of attributes that are the same in all frames."""
        ids, size = values_of(self._ids), values_of(self._size)
        if ids is not None and len(np.unique(ids)) != len(ids):
            yield f"ids are not unique: {len(ids) - len(np.unique(ids))} of {len(ids)} repeat another"
        if size is not None and not (np.isfinite(size) & (size > 0)).all():
            yield f"{self._size.GetName()} are not all positive and finite"
        for attribute in (self._ids, self._size):
            if attribute.GetNumTimeSamples():
                yield f"{attribute.GetName()} change with time"

    def frame_problems(self, code: float) -> Iterator[str]:
        """Yield the problems of the frame at time code `code`."""
        position = values_of(self.position, code)
        if position is None or len(position) == 0:
            yield f"{self.position.GetName()} are empty"
            return
        for attribute in (self.position, *self._values):
            yield from _finite_problems(attribute, code)
        yield from self._length_problems(len(position), code)
        yield from self._index_problems(code)
        yield from self._orientation_problems(code)
        size = values_of(self._size, code)
        if size is not None and len(size) in (1, len(position)):
            half_width = size / 2.0 if self._are_points else size[:, 0]
            yield from _extent_problems(self._extent, position, half_width, code)
            if complaint := too_coarse(position, half_width):
                yield f"{self.position.GetName()} are rounded: {complaint}"

    def _length_problems(self, grains: int, code: float) -> Iterator[str]:
        expected = dict.fromkeys((*self._values, self._ids, self._size), grains)
        if self._are_points and UsdGeom.Points(self._size.GetPrim()).GetWidthsInterpolation() == "constant":
            expected[self._size] = 1
        for attribute, length in expected.items():
            yield from _length_problem(attribute, length, f"{grains} grains", code)

    def _index_problems(self, code: float) -> Iterator[str]:
        for attribute, length in self._table_of.items():
            indices = values_of(attribute, code)
            if indices is not None and not ((indices >= 0) & (indices < length)).all():
                yield f"{attribute.GetName()} are not all below {length}"

    def _orientation_problems(self, code: float) -> Iterator[str]:
        if self._orientations not in self._values or not self._angle:
            return
        angle, turned = values_of(self._angle, code), values_of(self._orientations, code)
        if angle is None or turned is None or turned.shape != (len(angle), 4):
            return
        if (np.abs(turned - quaternions(angle)) > _HALF).any():
            yield "orientations are not those of the angles"


class ForcesInspector:
    """Checks of the force chains, a mesh of bands whose `animated` attributes have the grains' time codes."""

    def __init__(self, prim: Usd.Prim) -> None:
        names = ("points", "faceVertexCounts", "faceVertexIndices", "primvars:force", "extent")
        tangential = prim.GetAttribute(TANGENTIAL)
        self._forces = [prim.GetAttribute("primvars:force"), *([tangential] if tangential else [])]
        self._grains = [prim.GetAttribute(f"primvars:{name}") for name in GRAINS_OF]
        self.animated = [*(prim.GetAttribute(name) for name in names), *self._forces[1:], *self._grains]

    def frame_problems(self, code: float) -> Iterator[str]:
        """Yield the problems of the frame at time code `code`."""
        points, _, indices, _, extent = self.animated[:5]
        corners, vertices, numbers = (values_of(attribute, code) for attribute in self.animated[:3])
        if corners is None or vertices is None or numbers is None:
            yield "force chains lack points, faceVertexCounts or faceVertexIndices"
            return
        yield from _length_problem(points, int(vertices.sum()), f"{len(vertices)} bands", code)
        yield from _length_problem(indices, len(corners), f"{len(corners)} corners", code)
        for attribute in (*self._forces, *self._grains):
            yield from _length_problem(attribute, len(vertices), f"{len(vertices)} bands", code)
        for attribute in (points, *self._forces):
            yield from _finite_problems(attribute, code)
        if len(corners):
            yield from _extent_problems(extent, corners, np.zeros(len(corners)), code)


def _length(attribute: Usd.Attribute, code: float = 0.0) -> int:
    values = values_of(attribute, code)
    return 0 if values is None else len(values)


def _finite_problems(attribute: Usd.Attribute, code: float) -> Iterator[str]:
    values = values_of(attribute, code)
    if values is not None and not np.isfinite(values).all():
        yield f"{attribute.GetName()} are not all finite"


def _length_problem(attribute: Usd.Attribute, length: int, reason: str, code: float) -> Iterator[str]:
    values = values_of(attribute, code)
    found = 0 if values is None else len(values)
    if found != length:
        yield f"{attribute.GetName()} hold {found} values, not {length} for {reason}"


def _extent_problems(
    attribute: Usd.Attribute, places: Values, half_width: Values, code: float
) -> Iterator[str]:
    extent = values_of(attribute, code)
    if extent is None or extent.shape != (2, 3):
        yield "extent is not two corners"
        return
    centre, reach = places.astype(np.float64), half_width.astype(np.float64)[:, np.newaxis]
    if ((centre - reach < extent[0]) | (centre + reach > extent[1])).any():
        yield "extent does not contain all grains or bands"
