"""Checks of a recording that no USD validator makes."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdPhysics

from warpgrains.errors import SceneError
from warpgrains.usd_stage import GRAINS


def inspect_recording(path: str | Path) -> list[str]:
    """Return what is wrong with a recording, one line a problem; an empty list means nothing is.

    Parameters
    ----------
    path : str or Path
        The USD file.

    Raises
    ------
    SceneError
        If the file is missing or is not USD.
    """
    stage = _open(Path(path))
    prim = stage.GetPrimAtPath(GRAINS)
    if not (prim and prim.IsA(UsdGeom.Points)):
        return [*_stage_problems(stage), f"there is no UsdGeom.Points at {GRAINS}"]
    grains = UsdGeom.Points(prim)
    codes = grains.GetPointsAttr().GetTimeSamples()
    return [
        *_stage_problems(stage),
        *_time_problems(stage, grains, codes),
        *_static_problems(grains),
        *_frames_problems(grains, codes),
    ]


def _open(path: Path) -> Usd.Stage:
    if not path.is_file():
        raise SceneError(f"recording '{path}' does not exist")
    try:
        return Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        raise SceneError(f"recording '{path}' is not a USD file that can be read") from error


def _stage_problems(stage: Usd.Stage) -> Iterator[str]:
    if UsdGeom.GetStageUpAxis(stage) != UsdGeom.Tokens.y:
        yield f"upAxis is {UsdGeom.GetStageUpAxis(stage)}, not Y"
    if UsdGeom.GetStageMetersPerUnit(stage) != 1.0:
        yield f"metersPerUnit is {UsdGeom.GetStageMetersPerUnit(stage)}, not 1"
    if not UsdPhysics.StageHasAuthoredKilogramsPerUnit(stage):
        yield "kilogramsPerUnit is not stated"
    if not stage.GetDefaultPrim():
        yield "there is no defaultPrim"
    if stage.GetTimeCodesPerSecond() != stage.GetFramesPerSecond():
        yield (
            f"timeCodesPerSecond {stage.GetTimeCodesPerSecond():g} differs "
            f"from framesPerSecond {stage.GetFramesPerSecond():g}"
        )


def _time_problems(stage: Usd.Stage, grains: UsdGeom.Points, codes: list[float]) -> Iterator[str]:
    if not codes:
        yield "points have no frames"
        return
    for attribute in (grains.GetVelocitiesAttr(), grains.GetExtentAttr()):
        if attribute.GetTimeSamples() != codes:
            yield f"{attribute.GetName()} and points have different time codes"
    if codes != [codes[0] + frame for frame in range(len(codes))] or codes[0] != int(codes[0]):
        yield "the time codes of points are not consecutive integers"
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if (start, end) != (codes[0], codes[-1]):
        frames = f"{codes[0]:g} to {codes[-1]:g}"
        yield f"startTimeCode and endTimeCode are {start:g} and {end:g}, the frames {frames}"


def _static_problems(grains: UsdGeom.Points) -> Iterator[str]:
    ids = _values(grains.GetIdsAttr())
    if ids is None:
        yield "there are no ids"
    elif len(np.unique(ids)) != len(ids):
        yield f"ids are not unique: {len(ids) - len(np.unique(ids))} of {len(ids)} repeat another"
    widths = _values(grains.GetWidthsAttr())
    if widths is None:
        yield "there are no widths"
    elif not (np.isfinite(widths) & (widths > 0)).all():
        yield "widths are not all positive and finite"
    for attribute in (grains.GetIdsAttr(), grains.GetWidthsAttr()):
        if attribute.GetNumTimeSamples():
            yield f"{attribute.GetName()} change with time"


def _frames_problems(grains: UsdGeom.Points, codes: list[float]) -> Iterator[str]:
    """Yield each problem once, with the first frame that has it and the number of others."""
    found: dict[str, list[float]] = {}
    for code in codes:
        for problem in _frame_problems(grains, code):
            found.setdefault(problem, []).append(code)
    for problem, where in found.items():
        others = f" and {len(where) - 1} more" if len(where) > 1 else ""
        yield f"{problem} (frame {where[0]:g}{others})"


def _frame_problems(grains: UsdGeom.Points, code: float) -> Iterator[str]:
    points = _values(grains.GetPointsAttr(), code)
    if points is None or len(points) == 0:
        yield "points are empty"
        return
    if not np.isfinite(points).all():
        yield "points are not all finite"
    yield from _length_problems(grains, len(points), code)
    velocities = _values(grains.GetVelocitiesAttr(), code)
    if velocities is not None and not np.isfinite(velocities).all():
        yield "velocities are not all finite"
    yield from _extent_problems(grains, points, code)


def _length_problems(grains: UsdGeom.Points, count: int, code: float) -> Iterator[str]:
    colour = grains.GetDisplayColorPrimvar()
    expected = {
        grains.GetVelocitiesAttr(): count,
        grains.GetIdsAttr(): count,
        grains.GetWidthsAttr(): _per_grain(grains.GetWidthsInterpolation(), count),
        colour.GetAttr(): _per_grain(colour.GetInterpolation(), count),
    }
    for attribute, length in expected.items():
        values = _values(attribute, code)
        found = 0 if values is None else len(values)
        if found != length:
            yield f"{attribute.GetName()} hold {found} values, not {length} as points ask for"


def _per_grain(interpolation: str, count: int) -> int:
    return 1 if interpolation == UsdGeom.Tokens.constant else count


def _extent_problems(grains: UsdGeom.Points, points: np.ndarray[Any, Any], code: float) -> Iterator[str]:
    extent = _values(grains.GetExtentAttr(), code)
    widths = _values(grains.GetWidthsAttr(), code)
    if extent is None or extent.shape != (2, 3):
        yield "extent is not two corners"
        return
    if widths is None or len(widths) not in (1, len(points)):
        return
    centre, half_width = points.astype(np.float64), widths.astype(np.float64)[:, np.newaxis] / 2
    outside = (centre - half_width < extent[0]) | (centre + half_width > extent[1])
    if outside.any():
        yield "extent does not cover the discs"


def _values(attribute: Usd.Attribute, code: float = 0.0) -> np.ndarray[Any, Any] | None:
    """Return the value at a time code as an array, None where there is none."""
    value = attribute.Get(code)
    return None if value is None else np.array(value)
