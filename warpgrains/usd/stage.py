"""The part of a recording that is the same in all frames, and functions that all its prims need."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdLux, UsdPhysics, UsdShade, UsdUtils, Vt

import warpgrains
from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.base.frame_log import Arrays
from warpgrains.drawing.colors import linear, mark_color
from warpgrains.drawing.shapes import Shape
from warpgrains.space.bounds import Bounds

if TYPE_CHECKING:
    from warpgrains.scene.snapshot import Snapshot

Values = NDArray[Any]

RECORDED_BY = "warpgrains"
"""Key in a layer's custom data that identifies a recording."""
MATERIAL = Sdf.Path("/World/Looks/DisplayColor")
CAMERA = Sdf.Path("/World/main_cam")
"""The camera, under the name that usdview and usdrecord select."""

_FOCAL_LENGTH = 50.0
_APERTURE = 24.0
_SKY = 0.4  # fraction of the light from the sky; also the brightness of the background, if shown
_FROM_FRONT = (1.0 - _SKY) * 0.7853981633974483  # pi / 4: in Blender, fully lit faces keep their color
_COARSEST = 0.01  # distance of float32 coordinates, in smallest radii
_INFINITY = np.float32(np.inf)


class Drawing(Protocol):
    """Interface of classes such as `Grains`, which author a prim with constant and changing attributes."""

    def define(self, stage: Usd.Stage) -> None:
        """Author the prim, and all attributes that are the same in all frames."""

    def samples(self, now: Snapshot) -> Arrays:
        """Return the values of the attributes that change, in the frame `now`, by their USD paths."""


def static_layer(
    text: str, rate: float, drawings: Iterable[Drawing], data: Mapping[str, Any], view: Bounds
) -> Sdf.Layer:
    """Return an anonymous layer with all that frames share.

    Parameters
    ----------
    text
        Text of the scene file.
    rate
        Frames, which are time codes, per second as played [1/s].
    data
        Custom data of the layer, from which the recording is read.
    view
        Rectangle that the camera shows [m].
    """
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    stage = Usd.Stage.Open(layer)
    world = UsdGeom.Xform.Define(stage, "/World").GetPrim()
    stage.SetDefaultPrim(world)
    set_kind(world, "component")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    layer.documentation = f"Recorded by warpgrains {warpgrains.__version__} from the scene:\n\n{text}"
    layer.customLayerData = {
        RECORDED_BY: data,
        "cameraSettings": {"boundCamera": str(CAMERA)},  # the camera that Omniverse uses
    }
    _define_material(stage)
    _define_lights(stage)
    _define_camera(stage, view)
    for drawing in drawings:
        drawing.define(stage)
    return layer


def _define_material(stage: Usd.Stage) -> None:
    """Define the material of all prims. It is matt and takes its color from the primvar displayColor."""
    UsdGeom.Scope.Define(stage, MATERIAL.GetParentPath())
    material = UsdShade.Material.Define(stage, MATERIAL)
    surface = UsdShade.Shader.Define(stage, MATERIAL.AppendChild("Surface"))
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
    surface.CreateInput("useSpecularWorkflow", Sdf.ValueTypeNames.Int).Set(1)
    surface.CreateInput("specularColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(0.0))
    reader = UsdShade.Shader.Define(stage, MATERIAL.AppendChild("Color"))
    reader.CreateIdAttr("UsdPrimvarReader_float3")
    reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("displayColor")
    color = reader.CreateOutput("result", Sdf.ValueTypeNames.Float3)
    surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(color)
    shown = surface.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(shown)


def bind_material(prim: Usd.Prim, color: FloatArray | None = None) -> None:
    """Bind the material of all prims to a prim. If a color (sRGB) is given, set its displayColor."""
    if color is not None:
        value = Vt.Vec3fArray([Gf.Vec3f(*linear(color).tolist())])
        UsdGeom.Gprim(prim).CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(value)
    material = UsdShade.Material.Get(prim.GetStage(), MATERIAL)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def define_mesh(stage: Usd.Stage, path: Sdf.Path, shape: Shape, color: FloatArray) -> None:
    """Define the mesh of a shape with a color (sRGB) and the material of all prims.

    If the shape has a mark, which shows its rotation, these faces are darker or lighter (`mark_color`).
    """
    mesh, tokens = UsdGeom.Mesh.Define(stage, path), UsdGeom.Tokens
    points = Vt.Vec3fArray.FromNumpy(shape.points.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(shape.counts.astype(np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(shape.corners.astype(np.int32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(shape.normals.astype(np.float32)))
    mesh.SetNormalsInterpolation(tokens.vertex if shape.is_round else tokens.uniform)
    mesh.CreateSubdivisionSchemeAttr(tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    bind_material(mesh.GetPrim(), color)
    if shape.marked is not None:
        primvar, both = mesh.GetDisplayColorPrimvar(), np.stack([color, mark_color(color)])
        primvar.SetInterpolation(tokens.uniform)
        primvar.Set(Vt.Vec3fArray.FromNumpy(linear(both)))
        primvar.SetIndices(Vt.IntArray.FromNumpy(shape.marked.astype(np.int32)))


def set_kind(prim: Usd.Prim, kind: str) -> None:
    Usd.ModelAPI(prim).SetKind(getattr(Kind.Tokens, kind))


def _define_lights(stage: Usd.Stage) -> None:
    """Define a bright sky, and a distant light along the view."""
    sky = UsdLux.DomeLight.Define(stage, "/World/Sky")
    sky.CreateIntensityAttr(_SKY)
    sky.CreateColorAttr(Gf.Vec3f(1.0))  # Blender ignores a sky without a color
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.CreateIntensityAttr(_FROM_FRONT)
    light.CreateNormalizeAttr(True)


def _define_camera(stage: Usd.Stage, view: Bounds) -> None:
    """Define a perspective camera on the z axis, because Blender misreads orthographic apertures.

    The aperture is square, but higher than wide in the last bits. Therefore Blender fits it to the height of
    pictures, and square and wide pictures show the whole view.
    """
    distance = view.half * 2.0 * _FOCAL_LENGTH / _APERTURE
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    camera.AddTranslateOp().Set(Gf.Vec3d(*view.center, distance))
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.CreateFocalLengthAttr(_FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(_APERTURE)
    camera.CreateVerticalApertureAttr(_APERTURE * (1.0 + 1e-6))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 10.0 * distance))


def triples(what: str, values: FloatArray) -> NDArray[np.float32]:
    """Return vectors, shape (n, 2), as float32 vectors with z = 0, shape (n, 3).

    Raises InputError, which begins with `what`, if they are too large for float32.
    """
    shown = np.zeros((len(values), 3), dtype=np.float32)
    shown[:, :2] = as_float32(what, values)
    return shown


def values_of(attribute: Usd.Attribute, code: float = 0.0) -> Values | None:
    """Return an array at a time code, or None without a value. Raises TypeError if it is not of numbers."""
    value = attribute.Get(code)
    if value is None:
        return None
    kind, array = type(value).__name__, np.array(value)
    if not kind.endswith("Array") or array.dtype.kind not in "fiu":
        raise TypeError(f"{attribute.GetPath()} is a {kind}, not an array of numbers")
    return array


def numbers(attribute: Usd.Attribute, code: float = 0.0, shape: tuple[int, ...] | None = None) -> FloatArray:
    """Return an array at a time code as float64.

    Raises TypeError if there is no array of numbers, and ValueError if it has another shape than a given one,
    or is not finite.
    """
    array = values_of(attribute, code)
    if array is None:
        raise TypeError(f"{attribute.GetPath()} has no value")
    if shape is not None and array.shape != shape:
        raise ValueError(f"{attribute.GetPath()} has shape {array.shape}, not {shape}")
    if not np.isfinite(array).all():
        raise ValueError(f"{attribute.GetPath()} is not finite")
    return array.astype(np.float64)


def as_float32(what: str, values: FloatArray) -> NDArray[np.float32]:
    """Return values as float32. Raises InputError, which begins with `what`, if one is too large for it."""
    with np.errstate(over="ignore"):
        shown = values.astype(np.float32)
    if not np.isfinite(shown).all():
        raise InputError(f"{what} is {np.abs(values).max():.3g}: a recording holds at most 3.4e38")
    return shown


def too_coarse(position: FloatArray, radius: FloatArray) -> str | None:
    """Return a message if float32 coordinates are more than 1 % of the smallest radius apart, else None."""
    step, smallest = float(np.spacing(np.float32(np.abs(position).max()))), float(radius.min())
    if not step > _COARSEST * smallest:
        return None
    return f"float32 coordinates are {step:.3g} m apart there, but the smallest radius is {smallest:.3g} m"


def covering_extent(shown: NDArray[np.float32], half_width: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the lower and upper corner of the box about spheres [m], shape (2, 3), rounded outwards.

    `shown` holds the centers, shape (n, 3), and `half_width` the radii, shape (n,).
    """
    edges = np.empty((3, len(shown)))  # one row per component, because NumPy reduces long rows much faster
    box = np.empty((2, 3), dtype=np.float32)
    low = np.subtract(shown.T, half_width, out=edges).min(axis=1)
    np.nextafter(low.astype(np.float32), -_INFINITY, out=box[0])
    high = np.add(shown.T, half_width, out=edges).max(axis=1)
    np.nextafter(high.astype(np.float32), _INFINITY, out=box[1])
    return box


_WRITES = "`warpgrains run SCENE -o FILE.usdc` writes one"


def open_recording(path: Path) -> Usd.Stage:
    """Open a recording. Raises InputError if the file is missing or cannot be read."""
    if path.is_dir():
        raise InputError(f"recording '{path}' is a folder: give its files, such as {path}/*.usdc")
    if not path.is_file():
        raise InputError(f"recording '{path}' does not exist: {_WRITES}")
    try:
        _unprinted = UsdUtils.CoalescingDiagnosticDelegate()  # USD's warnings would be lines beside ours
        # not the layer that USD keeps of an earlier file of this name
        return Usd.Stage.Open(Sdf.Layer.OpenAsAnonymous(str(path)))
    except Tf.ErrorException as error:
        raise InputError(f"recording '{path}' is not a USD file that can be read: {_WRITES}") from error


@contextmanager
def refusing_untrusted_content(path: str | Path) -> Iterator[None]:
    """Turn any exception of USD or NumPy that a damaged recording causes into an InputError."""
    try:
        yield
    except (InputError, OSError, MemoryError):
        raise
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"recording '{path}' is damaged: {reason}") from error
