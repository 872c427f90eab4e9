"""Export of recordings for ParaView and pyvista: grains, contacts and walls, written by VTK itself."""

import re
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.drawing.chains import all_contacts, contact_lines, cut
from warpgrains.drawing.shapes import drawn_walls, moved_walls, wall_mesh
from warpgrains.errors import InputError, requiring
from warpgrains.files import draft_of, make_folder, require_writable_path, resolve_link, write_atomically
from warpgrains.locks import Lock
from warpgrains.usd.recording import Recording

_FRAME = re.compile(r"(\.draft\.)?([a-z]+-)?\d{4,}\.vtp")  # drafts are those of an export that was killed


def export(recording: str | Path, output: str | Path) -> int:
    """Write the frames of a recording as files of VTK, and return their number.

    RUN.pvd lists the times, and for each the files ``RUN/grains-0000.vtp`` and so on of its blocks:

    - ``Grains``: points with vertex cells, in the box if it is periodic, and then images of the grains that
      cross its sides. Point data are `grain` (the number), `radius` [m], `mass` [kg],
      `velocity` [m/s], and what else is recorded: `speed` [m/s], `pressure` [N/m], and with friction `spin`
      [rad/s], `angle` [rad] and `mobilized`.
    - ``Contacts``, if recorded: lines between centers, or from a center to a wall. Cell data are `force` [N],
      with friction `tangential_force` [N], and `grain` and `other`: another grain, -1 for the outer wall, -2
      for the inner one, or -3, -4, ... for those of `Scene.walls`.
    - ``Walls``: polygons, as drawn. If no wall moves, there is one file.
    """
    output = Path(output)
    require_writable_path("output", output, ".pvd")
    with requiring("export", "data"):
        import vtkmodules.vtkIOXML  # noqa: F401
    source = Recording(recording)
    with Lock(output):
        _write(source, output)
    return len(source)


def _write(source: Recording, output: Path) -> None:
    """Write the files of all frames into a folder next to the output, and then the list of them."""
    folder = resolve_link(output).with_suffix("")
    earlier = [*folder.iterdir()] if folder.is_dir() else []
    if any(not _FRAME.fullmatch(path.name) for path in earlier):
        raise InputError(f"refusing to overwrite folder '{folder}': it holds other files than frames")
    make_folder(folder)
    lines, latest, written = list[str](), dict[str, Path](), set[Path]()
    with ExitStack() as drafts:
        for k, time in enumerate(source.time.tolist()):
            for name, data in _blocks(source, k).items():
                latest[name] = folder / f"{name.lower()}-{k:04}.vtp"
                drafts.enter_context(draft_of(latest[name])).write_bytes(_vtp(data))
            written.update(latest.values())
            lines += [
                f'    <DataSet timestep="{time!r}" part="{part}" name="{name}"'
                f" file={quoteattr(f'{folder.name}/{path.name}')}/>"
                for part, (name, path) in enumerate(latest.items())
            ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    write_atomically(output, "\n".join([*head, *lines, "  </Collection>", "</VTKFile>", ""]).encode())
    for path in earlier:
        if path not in written:
            path.unlink(missing_ok=True)


def _vtp(data: Any) -> bytes:
    """Return polydata as the content of a file; VTK reports no error when a disk is full."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(data)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    return bytes(writer.GetOutputString(), "utf-8")


def _blocks(source: Recording, k: int) -> dict[str, Any]:
    """Return the polydata of a frame by name, without walls if they are as in the frame before."""
    frame = source.frame(k, contacts=source.has_forces)
    (places, number), scene = frame.images, frame.scene
    grains = _polydata(places)
    grains.SetVerts(_cells(np.arange(len(places))[:, np.newaxis]))
    own = {**frame.recorded, "radius": scene.radius, "mass": scene.mass}
    own |= {"spin": frame.spin, "angle": frame.angle} if scene.has_friction else {}
    of_grain: dict[str, Any] = dict(sorted(own.items())) | {
        "grain": np.arange(frame.n),
        "velocity": _in_space(frame.velocity),
    }
    _add(grains.GetPointData(), {name: values[number] for name, values in of_grain.items()})
    found = {"Grains": grains}
    if source.has_forces:
        pair, force, tangential = all_contacts(frame)
        start, end, _ = contact_lines(frame, pair)
        start, end, contact = cut(scene.space, start, end)
        ends = np.stack([start, end], axis=1).reshape(-1, 2)
        found["Contacts"] = contacts = _polydata(ends)
        contacts.SetLines(_cells(np.arange(len(ends)).reshape(-1, 2)))
        carried = {"force": force} | ({"tangential_force": tangential} if scene.has_friction else {})
        ends_of = {"grain": pair[contact, 0], "other": pair[contact, 1]}
        _add(contacts.GetCellData(), ends_of | {name: own[contact] for name, own in carried.items()})
    moved = moved_walls(scene, scene, frame.time)
    meshes = [wall_mesh(band) for band in (drawn_walls(scene) | moved).values()]
    if meshes and (moved or k == 0):
        first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
        corners = [mesh.corners.reshape(-1, 4) + of for mesh, of in zip(meshes, first, strict=False)]
        found["Walls"] = _polydata(np.concatenate([mesh.points[:, :2] for mesh in meshes]))
        found["Walls"].SetPolys(_cells(np.concatenate(corners)))
    return found


def _polydata(places: FloatArray) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    points, data = vtkPoints(), vtkPolyData()
    points.SetData(numpy_to_vtk(_in_space(places), deep=True))
    data.SetPoints(points)
    return data


def _cells(corners: Any) -> Any:
    """Return c cells of k corners each, from corners of shape (c, k)."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    cells, flat = vtkCellArray(), np.ascontiguousarray(corners, np.int64)
    first = np.arange(len(flat) + 1, dtype=np.int64) * flat.shape[1]
    cells.SetData(numpy_to_vtkIdTypeArray(first, deep=True), numpy_to_vtkIdTypeArray(flat.ravel(), deep=True))
    return cells


def _add(to: Any, arrays: dict[str, Any]) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    for name, values in arrays.items():
        array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
        array.SetName(name)
        to.AddArray(array)


def _in_space(vectors: FloatArray) -> FloatArray:
    return np.column_stack([vectors, np.zeros(len(vectors))])
