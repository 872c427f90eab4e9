"""Checks of a recording that USD validators do not make: sizes, values and times of its arrays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics

from warpgrains.base import checks
from warpgrains.base.errors import InputError
from warpgrains.base.shown import number_of
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colors import ColorScale
from warpgrains.drawing.shapes import drawn_walls, moved_walls, wall_mesh
from warpgrains.usd.grains import (
    ANGLE,
    COLOR_INDICES,
    GRAINS,
    ID,
    OF_GRAINS,
    ORIENTATIONS,
    PERIODS,
    VELOCITIES,
    numbers_of,
    position_of,
    quaternions,
)
from warpgrains.usd.meshes import FORCES, GRAINS_OF, HEIGHT, PLACES, TANGENTIAL, THICKNESS, WALLS
from warpgrains.usd.recording import Recording
from warpgrains.usd.stage import (
    RECORDED_BY,
    Values,
    open_recording,
    refusing_untrusted_content,
    too_coarse,
    values_of,
)

_HALF = 1e-3  # of a quaternion: half precision, and angles as float32 up to 1e4 rad
_ROUNDED = 4  # float32 steps by which an extent may be larger than what it contains
_FINITE, _POSITIVE = (-np.inf, np.inf, "finite"), (0.0, np.inf, "positive and finite")


class Row(NamedTuple):
    """An attribute of a recording, and what its array must obey in each frame."""

    attribute: Usd.Attribute
    per: str | None = None
    """Kind of objects of which the array has one entry each, such as "grains"; None for any length.

    `_frame_problems` counts the objects of each kind in a frame.
    """
    within: tuple[float, float, str] = _FINITE
    """Low and high: each value must satisfy low < value < high. The text names this condition in messages."""
    is_still: bool | None = None
    """True if the array must not change with time, False if each frame must have a value; None for either."""


def inspect_recording(path: str | Path) -> list[str]:
    """Return the problems of a recording, one line each. Raises InputError if the file is not USD."""
    with refusing_untrusted_content(path):
        stage = open_recording(Path(path))
        found = _problems(stage)
        try:
            has_walls = bool(stage.GetPrimAtPath(WALLS))
            return [*found, *(_misplaced_walls(Recording(path), stage) if has_walls else ())]
        except InputError as error:
            return found or [str(error)]


def report_on_recording(path: str | Path) -> list[str]:
    """Return the lines that `check` prints: the problems of a recording, or else "OK" and its size."""
    if problems := inspect_recording(path):
        return problems
    with refusing_untrusted_content(path):
        stage = open_recording(Path(path))
        prim = stage.GetPrimAtPath(GRAINS)
        frames, mass = position_of(prim).GetNumTimeSamples(), _values(prim.GetAttribute(OF_GRAINS["mass"]))
        return [f"OK: {number_of(frames, 'frame')}, {number_of(len(mass), 'grain')}"]


def _problems(stage: Usd.Stage) -> list[str]:
    """Return the problems of a recording, one line each, but not walls at wrong places."""
    prim = stage.GetPrimAtPath(GRAINS)
    if not (prim and (prim.IsA(UsdGeom.Points) or prim.IsA(UsdGeom.PointInstancer))):
        return [f"no UsdGeom.Points or PointInstancer at {GRAINS}"]
    codes, rows = position_of(prim).GetTimeSamples(), _table(stage)
    if not codes:
        return ["the grains have no time samples"]
    problems = [*_stage_problems(stage, codes), *_scale_problems(stage)]
    for row in rows:
        name, samples = row.attribute.GetName(), row.attribute.GetTimeSamples()
        if row.is_still and samples:
            problems.append(f"{name} change with time")
        elif samples != codes and (samples or row.is_still is False):
            place = f"{row.attribute.GetPrim().GetName()}.{name}"
            problems.append(f"{place} has other time codes than the grains' positions")
    found: dict[str, list[float]] = {}
    for code in codes:
        for problem in _frame_problems(stage, rows, code):
            found.setdefault(problem, []).append(code)
    for problem, where in found.items():
        others = f" and {len(where) - 1} more" if len(where) > 1 else ""
        problems.append(f"{problem} (frame {where[0]:g}{others})")
    return problems


def _stage_problems(stage: Usd.Stage, codes: list[float]) -> list[str]:
    """Return the problems of units, time codes and ids.

    `codes` are the time codes at which the positions of the grains have samples.
    """
    up, meters = UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)
    rate, shown = stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond()
    ends = f"{stage.GetStartTimeCode():g} and {stage.GetEndTimeCode():g}"
    frames = f"{codes[0]:g} and {codes[-1]:g}"
    ids = _values(stage.GetPrimAtPath(GRAINS).GetAttribute("ids"))
    repeated = len(ids) - len(np.unique(ids))
    found = {
        f"upAxis is {up}, not Y": up != UsdGeom.Tokens.y,
        f"metersPerUnit is {meters}, not 1": meters != 1.0,
        "kilogramsPerUnit is missing": not UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage),
        "defaultPrim is missing": not stage.GetDefaultPrim(),
        f"timeCodesPerSecond {rate:g} differs from framesPerSecond {shown:g}": rate != shown,
        "the time codes of the grains are not 0, 1, 2, ...": codes != list(range(len(codes))),
        f"startTimeCode and endTimeCode are {ends}, but the frames are {frames}": ends != frames,
        f"ids are not unique: {repeated} of {len(ids)} repeat another": repeated > 0,
        f"no walls at {WALLS}": not stage.GetPrimAtPath(WALLS),
    }
    return [problem for problem, is_found in found.items() if is_found]


def _misplaced_walls(recording: Recording, stage: Usd.Stage) -> Iterator[str]:
    """Yield a problem for each wall that is not drawn where the scene of the recording has it."""
    scene, prim = recording.recorded_scene, stage.GetPrimAtPath(WALLS)
    thickness, height = (checks.positive(name, prim.GetAttribute(name).Get()) for name in (THICKNESS, HEIGHT))
    still = drawn_walls(scene, thickness)
    largest, where = dict.fromkeys(still, 0.0), dict[str, int]()
    for code in range(len(recording)):
        now = scene.placed(recording.places(code))
        moved = moved_walls(scene, now, recording.times.time(code), thickness)
        for name, band in (moved if code else still | moved).items():
            expected = wall_mesh(band, height).points
            points = _values(prim.GetChild(name).GetAttribute("points"), code)
            if points.shape != expected.shape:
                yield f"{name}: points hold {len(points)} values, not {len(expected)} (frame {code})"
                return
            distance = float(np.abs(points - expected).max())
            if distance > max(
                largest[name], _ROUNDED * float(np.spacing(np.float32(np.abs(expected).max())))
            ):
                largest[name], where[name] = distance, code
    for name, code in where.items():
        yield f"{name}: points are up to {largest[name]:.3g} m from where the wall is (frame {code})"


def _scale_problems(stage: Usd.Stage) -> Iterator[str]:
    """Yield the problems of the scales of colors and forces, if the recording has them."""
    data = stage.GetRootLayer().customLayerData.get(RECORDED_BY, {})
    for name, scale in (("colors", ColorScale), ("forces", ChainScale)):
        if name in data:
            try:
                scale.read(data[name])
            except (InputError, LookupError, TypeError) as error:
                yield f"the scale of {name} is damaged: {error}"


def _table(stage: Usd.Stage) -> list[Row]:
    """Return the rules for all arrays of a recording, a row for each attribute."""
    grains, forces, walls = (stage.GetPrimAtPath(path) for path in (GRAINS, FORCES, WALLS))
    are_points = grains.IsA(UsdGeom.Points)
    below = {COLOR_INDICES: len(_values(grains.GetAttribute("primvars:displayColor")))}
    if not are_points:
        below["protoIndices"] = len(UsdGeom.PointInstancer(grains).GetPrototypesRel().GetTargets())
    are_equal = are_points and UsdGeom.Points(grains).GetWidthsInterpolation() == "constant"
    values = [grains.GetAttribute(VELOCITIES)]
    of_grains = [grains.GetAttribute(name) for name in OF_GRAINS.values()]
    periods = grains.GetAttribute(PERIODS)
    is_open = of_grains[0].GetNumTimeSamples() > 0
    is_still = None if periods or is_open else True
    if grains.GetAttribute(ORIENTATIONS).HasAuthoredValue():
        values.append(grains.GetAttribute(ORIENTATIONS))
    rows = [
        Row(position_of(grains), "grains"),
        Row(grains.GetAttribute("extent"), is_still=False),
        *(Row(own, "grains") for own in (*values, *numbers_of(grains).values())),
        *(Row(grains.GetAttribute(name), "grains", (-1, n, f"below {n}")) for name, n in below.items()),
        *(Row(grains.GetAttribute(name), "grains", is_still=is_still) for name in ("ids", ID)),
        Row(_size_of(grains), "all grains" if are_equal else "grains", _POSITIVE, is_still=is_still),
        *(Row(own, "own grains", is_still=None if is_open else True) for own in of_grains),
        *([Row(periods, "own grains", is_still=False)] if periods else []),
    ]
    if forces:
        per = {"points": "sides", "faceVertexCounts": "bands", "faceVertexIndices": "corners", "extent": None}
        per |= {f"primvars:{name}": "bands" for name in ("force", *GRAINS_OF)}
        per |= {TANGENTIAL: "bands"} if forces.GetAttribute(TANGENTIAL) else {}
        rows += [Row(forces.GetAttribute(name), own, is_still=False) for name, own in per.items()]
    if walls:
        places = [walls.GetAttribute(PLACES)] if walls.GetAttribute(PLACES) else []
        each = (one.GetAttribute(name) for one in walls.GetChildren() for name in ("points", "normals"))
        rows += [Row(own) for own in (*places, *each)]
    return rows


def _frame_problems(stage: Usd.Stage, rows: list[Row], code: float) -> Iterator[str]:
    """Yield the problems of the frame at time code `code`; `rows` are the rules of `_table`."""
    grains, forces = stage.GetPrimAtPath(GRAINS), stage.GetPrimAtPath(FORCES)
    position, size = _values(position_of(grains), code), _values(_size_of(grains), code)
    n = len(position)
    if n == 0:
        yield f"{position_of(grains).GetName()} are empty"
        return
    radius, ids = (grains.GetAttribute(name) for name in (OF_GRAINS["radius"], "ids"))
    own = len(_values(radius, code)) if grains.GetAttribute(PERIODS) else n
    if ids.GetNumTimeSamples() and len(np.unique(_values(ids, code))) < n:
        yield "ids are not unique"
    counts = {"grains": (n, f"{n} grains"), "all grains": (1, f"{n} grains")}
    counts["own grains"] = own, f"{own} grains"  # images of others follow
    half_width = size[:, 0] if size.ndim == 2 else size / 2.0
    drawn = [(grains, position, half_width)] if len(size) in (1, n) else []
    for wall in stage.GetPrimAtPath(WALLS).GetChildren() if stage.GetPrimAtPath(WALLS) else ():
        points = _values(wall.GetAttribute("points"), code)
        drawn += [(wall, points, np.zeros(len(points)))] if len(points) else []
    if forces:
        corners, sides = (_values(forces.GetAttribute(name), code) for name in ("points", "faceVertexCounts"))
        bands = f"{len(sides)} bands"
        counts |= {"bands": (len(sides), bands), "sides": (int(sides.sum()), bands)}
        counts["corners"] = len(corners), f"{len(corners)} corners"
        drawn += [(forces, corners, np.zeros(len(corners)))] if len(corners) else []
    for row in rows:
        values, name, (low, high, what) = _values(row.attribute, code), row.attribute.GetName(), row.within
        if row.per is not None and len(values) != counts[row.per][0]:
            length, reason = counts[row.per]
            yield f"{name} hold {len(values)} values, not {length} for {reason}"
        if not ((low < values) & (values < high)).all():
            yield f"{name} are not all {what}"
    for prim, places, reach in drawn:
        for problem in _extent_problems(_values(prim.GetAttribute("extent"), code), places, reach):
            yield f"{prim.GetName()}: {problem}" if prim.GetParent().GetPath() == WALLS else problem
    if len(size) and half_width.min() > 0.0 and (complaint := too_coarse(position, half_width)):
        yield f"{position_of(grains).GetName()} are rounded: {complaint}"
    angle, turned = (_values(grains.GetAttribute(name), code) for name in (f"primvars:{ANGLE}", ORIENTATIONS))
    if turned.shape == (len(angle), 4) and (np.abs(turned - quaternions(angle)) > _HALF).any():
        yield "orientations are not those of the angles"


def _extent_problems(extent: Values, places: Values, half_width: Values) -> Iterator[str]:
    """Yield the problem of an extent, unless it is the box [m], shape (2, 3), about some objects.

    The objects have centers `places`, shape (n, 3), and half widths, shape (n,).
    """
    if extent.shape != (2, 3):
        yield "extent is not two corners"
        return
    centre, reach = places.astype(np.float64), half_width.astype(np.float64)[:, np.newaxis]
    low, high = (centre - reach).min(axis=0), (centre + reach).max(axis=0)
    if not ((low >= extent[0]) & (high <= extent[1])).all():
        yield "extent does not contain all grains, bands or points"
        return
    # it is rounded outwards, from half widths before they were rounded
    slack = _ROUNDED * float(np.spacing(np.float32(np.abs(extent).max())))
    if not ((low <= extent[0] + slack) & (high >= extent[1] - slack)).all():
        yield "extent is larger than that of all grains, bands or points"


def _size_of(grains: Usd.Prim) -> Usd.Attribute:
    return grains.GetAttribute("widths" if grains.IsA(UsdGeom.Points) else "scales")


def _values(attribute: Usd.Attribute, code: float = 0.0) -> Values:
    """Return the array of an attribute at a time code; without a value, an empty one."""
    values = values_of(attribute, code) if attribute else None
    return np.zeros(0) if values is None else values
