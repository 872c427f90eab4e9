"""What makes a recording look right when it is opened: a material of the colors, lights and a camera."""

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdLux, UsdShade, Vt

from warpgrains.arrays import FloatArray
from warpgrains.drawing.colormaps import linear
from warpgrains.drawing.shapes import Shape

PROTOTYPES = Sdf.Path("/World/Prototypes")
"""Shapes that are drawn where grains are instances of them: a class, which is not drawn itself."""
MATERIAL = Sdf.Path("/World/Looks/DisplayColor")
CAMERA = Sdf.Path("/World/main_cam")
"""By this name usdview and usdrecord know the camera to look through."""

_MARGIN = 1.05  # half-width of the picture, in that of what is to be seen
_FOCAL_LENGTH = 50.0
_APERTURE = 24.0
_SKY = 0.4  # share of the light; it is also how bright the background is, where a viewer shows one
_FROM_FRONT = (1.0 - _SKY) * 0.7853981633974483  # pi / 4: in Blender, what faces both has its own color


def define_looks(stage: Usd.Stage, reach: float) -> None:
    """Author the material, the lights and a camera that sees all within `reach` [m] of the origin."""
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
    _define_lights(stage)
    _define_camera(stage, _MARGIN * reach)


def bind_look(prim: Usd.Prim, color: FloatArray | None = None) -> None:
    """Give a prim the material, and one color (sRGB), unless it has colors of its own."""
    if color is not None:
        value = Vt.Vec3fArray([Gf.Vec3f(*linear(color).tolist())])
        UsdGeom.Gprim(prim).CreateDisplayColorPrimvar(UsdGeom.Tokens.constant).Set(value)
    material = UsdShade.Material.Get(prim.GetStage(), MATERIAL)
    UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)


def define_mesh(stage: Usd.Stage, path: Sdf.Path, shape: Shape, color: FloatArray) -> None:
    """Define a mesh of one color (sRGB), with the material."""
    mesh, tokens = UsdGeom.Mesh.Define(stage, path), UsdGeom.Tokens
    points = Vt.Vec3fArray.FromNumpy(shape.points.astype(np.float32))
    mesh.CreatePointsAttr(points)
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(shape.counts.astype(np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(shape.corners.astype(np.int32)))
    mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(shape.normals.astype(np.float32)))
    of_points = len(shape.normals) == len(points)
    mesh.SetNormalsInterpolation(tokens.vertex if of_points else tokens.faceVarying)
    mesh.CreateSubdivisionSchemeAttr(tokens.none)
    mesh.CreateDoubleSidedAttr(True)
    mesh.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(points))
    bind_look(mesh.GetPrim(), color)


def set_kind(prim: Usd.Prim, kind: str) -> None:
    """Set the kind of a prim, such as "component"."""
    Usd.ModelAPI(prim).SetKind(getattr(Kind.Tokens, kind))


def _define_lights(stage: Usd.Stage) -> None:
    """Define a bright sky, and a light along the view, whose power does not depend on its size."""
    sky = UsdLux.DomeLight.Define(stage, "/World/Sky")
    sky.CreateIntensityAttr(_SKY)
    sky.CreateColorAttr(Gf.Vec3f(1.0))  # Blender ignores a sky without a color
    light = UsdLux.DistantLight.Define(stage, "/World/Light")
    light.CreateIntensityAttr(_FROM_FRONT)
    light.CreateNormalizeAttr(True)


def _define_camera(stage: Usd.Stage, shown: float) -> None:
    """Define a perspective camera on the z axis: Blender misreads the aperture of an orthographic one.

    The aperture is square, and higher than wide by the last bits: so Blender fits it to the height of
    pictures, and all is seen in square and in wide ones.
    """
    distance = shown * 2.0 * _FOCAL_LENGTH / _APERTURE
    camera = UsdGeom.Camera.Define(stage, CAMERA)
    camera.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, distance))
    camera.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    camera.CreateFocalLengthAttr(_FOCAL_LENGTH)
    camera.CreateHorizontalApertureAttr(_APERTURE)
    camera.CreateVerticalApertureAttr(_APERTURE * (1.0 + 1e-6))
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.01 * distance, 10.0 * distance))
