"""Checks of a recording that no USD validator makes."""

from collections.abc import Callable, Iterator
from pathlib import Path

from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from warpgrains.usd.check_prims import ForcesInspector, GrainsInspector
from warpgrains.usd.forces import FORCES
from warpgrains.usd.grains import GRAINS
from warpgrains.usd.reader import open_recording


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
    stage = open_recording(Path(path))
    problems = list(_stage_problems(stage))
    prim = stage.GetPrimAtPath(GRAINS)
    if not (prim and (prim.IsA(UsdGeom.Points) or prim.IsA(UsdGeom.PointInstancer))):
        return [*problems, f"there are no UsdGeom.Points or PointInstancer at {GRAINS}"]
    grains = GrainsInspector(prim)
    codes = grains.position.GetTimeSamples()
    problems += [*_code_problems(stage, codes), *grains.static_problems()]
    problems += [*_alignment_problems(grains.animated, codes), *_by_frame(grains.frame_problems, codes)]
    if stage.GetPrimAtPath(FORCES):
        forces = ForcesInspector(stage.GetPrimAtPath(FORCES))
        problems += [*_alignment_problems(forces.animated, codes), *_by_frame(forces.frame_problems, codes)]
    return problems


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


def _code_problems(stage: Usd.Stage, codes: list[float]) -> Iterator[str]:
    if not codes:
        yield "the grains have no frames"
        return
    if codes != [codes[0] + frame for frame in range(len(codes))] or codes[0] != int(codes[0]):
        yield "the time codes of the grains are not consecutive integers"
    start, end = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    if (start, end) != (codes[0], codes[-1]):
        frames = f"{codes[0]:g} to {codes[-1]:g}"
        yield f"startTimeCode and endTimeCode are {start:g} and {end:g}, the frames {frames}"


def _alignment_problems(attributes: list[Usd.Attribute], codes: list[float]) -> Iterator[str]:
    for attribute in attributes:
        if attribute.GetTimeSamples() != codes:
            yield f"{_place(attribute.GetPath())} has other time codes than the grains' positions"


def _by_frame(problems_of: Callable[[float], Iterator[str]], codes: list[float]) -> Iterator[str]:
    """Yield each problem once, with the first frame that has it and the number of others."""
    found: dict[str, list[float]] = {}
    for code in codes:
        for problem in problems_of(code):
            found.setdefault(problem, []).append(code)
    for problem, where in found.items():
        others = f" and {len(where) - 1} more" if len(where) > 1 else ""
        yield f"{problem} (frame {where[0]:g}{others})"


def _place(path: Sdf.Path) -> str:
    return f"{path.GetPrimPath().name}.{path.name}"
