"""Export of recordings for ParaView and pyvista: grains, contacts and forces, written by VTK itself."""

import os
import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from errno import EIO
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr
from zlib import crc32

import numpy as np

from warpgrains.analysis.recording import Recording
from warpgrains.arrays import FloatArray
from warpgrains.console import STDERR, redirected
from warpgrains.drawing.chains import contact_ends, contact_normals, with_walls
from warpgrains.errors import InputError, requiring
from warpgrains.files import draft_of, make_folder, require_writable_path, resolve_link, write_atomically
from warpgrains.locks import Lock

SUFFIXES = (".vtkhdf", ".pvd")
_FRAME = re.compile(r"(\.draft\.)?\d{4,}\.vtp")  # drafts are those of an export that was killed


def export(recording: str | Path, output: str | Path) -> int:
    """Write the frames of a recording as files of VTK, and return their number.

    An output that ends in ``.vtkhdf`` is one file with time steps. One that ends in ``.pvd`` is a list of
    times and files: RUN.pvd lists RUN/0000.vtp, RUN/0001.vtp and so on.

    Each frame is one polydata. Its first points are the grains, each with a vertex cell, with radius [m] and
    velocity [m/s]. Contacts, if recorded, are lines between grains, or from a grain to its contact point on
    a wall, a point of radius 0. The force [N] is cell data, 0 on vertices. With friction, grains
    also have spin [rad/s] and angle [rad], and contacts the tangential force [N].

    Raises
    ------
    InputError
        The recording cannot be read, the output cannot be written, the folder of a series holds other
        files, or VTK, which the extra ``[data]`` installs, is missing. It is an `OutputError` if another
        process writes the output.
    OSError
        A file cannot be written, or reads back different.
    """
    output = Path(output)
    require_writable_path("output", output, *SUFFIXES)
    with requiring("export", "data"):
        import vtkmodules.vtkIOHDF  # noqa: F401
    source = Recording(recording)
    with Lock(output):
        (_write_series if output.suffix == ".pvd" else _write_hdf)(source, output)
    return len(source)


def _write_series(source: Recording, output: Path) -> None:
    """Write a file for each frame into a folder next to the output, and then the list of them."""
    from vtkmodules.vtkIOXML import vtkXMLPolyDataReader, vtkXMLPolyDataWriter

    folder = resolve_link(output).with_suffix("")
    earlier = [*folder.iterdir()] if folder.is_dir() else []
    if any(not _FRAME.fullmatch(path.name) for path in earlier):
        raise InputError(f"refusing to overwrite folder '{folder}': it holds other files than frames")
    make_folder(folder)
    names = [f"{k:04}.vtp" for k in range(len(source))]
    with ExitStack() as drafts:
        for k, name in enumerate(names):
            writer, reader, data = vtkXMLPolyDataWriter(), vtkXMLPolyDataReader(), _polydata(source, k)
            writer.SetInputData(data)
            draft = drafts.enter_context(draft_of(folder / name))
            _write_checked(draft, writer, reader, reader.SetTimeStep, {0: _checksum(data)})
    lines = [
        f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(f"{folder.name}/{name}")}/>'
        for time, name in zip(source.time.tolist(), names, strict=True)
    ]
    head = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1">', "  <Collection>"]
    text = "\n".join([*head, *lines, "  </Collection>", "</VTKFile>", ""])
    write_atomically(output, text.encode())
    for path in earlier:
        if path.name not in names:
            path.unlink()


def _write_hdf(source: Recording, output: Path) -> None:
    from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
    from vtkmodules.vtkCommonDataModel import vtkDataObject
    from vtkmodules.vtkIOHDF import vtkHDFReader, vtkHDFWriter

    class Frames(VTKPythonAlgorithmBase):
        """VTK source that provides the frame of each time that the writer requests."""

        def __init__(self) -> None:
            super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkPolyData")

        def RequestInformation(self, _: Any, __: Any, out: Any) -> int:  # noqa: N802
            executive, information = self.GetExecutive(), out.GetInformationObject(0)
            information.Remove(executive.TIME_STEPS())
            for time in source.time:
                information.Append(executive.TIME_STEPS(), time)
            information.Set(executive.TIME_RANGE(), (source.time[0], source.time[-1]), 2)
            return 1

        def RequestData(self, _: Any, __: Any, out: Any) -> int:  # noqa: N802
            information, time = out.GetInformationObject(0), self.GetExecutive().UPDATE_TIME_STEP()
            asked = information.Get(time) if information.Has(time) else source.time[0]
            k = int(np.abs(source.time - asked).argmin())
            data = _polydata(source, k)
            checksums[k] = _checksum(data)
            vtkDataObject.GetData(information).ShallowCopy(data)
            return 1

    checksums: dict[int, int] = {}
    frames, writer, reader = Frames(), vtkHDFWriter(), vtkHDFReader()
    writer.SetInputConnection(frames.GetOutputPort())
    writer.SetWriteAllTimeSteps(True)
    with draft_of(output) as draft:
        _write_checked(draft, writer, reader, reader.SetStep, checksums)


def _write_checked(
    draft: Path, writer: Any, reader: Any, select: Callable[[int], None], checksums: Mapping[int, int]
) -> None:
    """Write a file, and read it back. Raises OSError unless its steps have the checksums.

    The writer may add checksums. What VTK and HDF5 print is dropped.
    """
    with open(os.devnull, "w") as dropped, redirected(STDERR, dropped.fileno()):
        writer.SetFileName(str(draft))
        is_written = writer.Write()
        reader.SetFileName(str(draft))
        for k, checksum in checksums.items():
            select(k)
            reader.Update()
            is_written &= _checksum(reader.GetOutput()) == checksum
    if not is_written:
        raise OSError(EIO, "what VTK wrote reads back different: check the free space")


def _checksum(data: Any) -> int:
    """Return the CRC-32 of the numbers of polydata; 0 if it has no points."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    if data.GetNumberOfPoints() == 0:
        return 0
    cells = data.GetVerts(), data.GetLines()
    arrays = [data.GetPoints().GetData(), *(own.GetConnectivityArray() for own in cells)]
    for own in (data.GetPointData(), data.GetCellData()):
        arrays += map(own.GetArray, sorted(map(own.GetArrayName, range(own.GetNumberOfArrays()))))
    return crc32(b"".join(vtk_to_numpy(array).tobytes() for array in arrays))


def _polydata(source: Recording, k: int) -> Any:
    """Return a frame as VTK polydata."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    frame = source.frame(k, contacts=source.has_forces)
    pair = with_walls(frame.pair, frame.wall)
    n, between = frame.n, pair[:, 1] >= 0
    wall = pair[~between, 0]
    normal = contact_normals(frame.scene, frame.position, pair[~between], frame.time)
    touched = contact_ends(frame.scene, frame.position, pair[~between], normal)[:, 1]
    pair[~between, 1] = n + np.arange(len(wall))
    points, data = vtkPoints(), vtkPolyData()
    points.SetData(numpy_to_vtk(_in_space(np.concatenate([frame.position, touched])), deep=True))
    data.SetPoints(points)
    data.SetVerts(_cells(np.arange(n)[:, np.newaxis]))
    data.SetLines(_cells(pair))
    none, still = np.zeros(n), np.zeros((len(wall), 2))
    forces = {"force": np.concatenate([none, frame.force, frame.wall_force])}
    arrays = {
        "radius": np.append(source.radius, np.zeros(len(wall))),
        "velocity": _in_space(np.concatenate([frame.velocity, still])),
        "grain": np.append(np.arange(n), wall),
    }
    if frame.scene.has_friction:
        arrays |= {name: np.append(getattr(frame, name), still[:, 0]) for name in ("spin", "angle")}
        tangential = frame.tangential_force, frame.wall_tangential_force
        forces["tangential_force"] = np.concatenate([none, *tangential])
    for name, values in arrays.items():
        _add(data.GetPointData(), name, values)
    for name, values in forces.items():
        _add(data.GetCellData(), name, values)
    return data


def _cells(corners: Any) -> Any:
    """Return c cells of k corners each, from corners of shape (c, k)."""
    from vtkmodules.util.numpy_support import numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray

    cells, flat = vtkCellArray(), np.ascontiguousarray(corners, np.int64)
    first = np.arange(len(flat) + 1, dtype=np.int64) * flat.shape[1]
    cells.SetData(numpy_to_vtkIdTypeArray(first, deep=True), numpy_to_vtkIdTypeArray(flat.ravel(), deep=True))
    return cells


def _add(to: Any, name: str, values: Any) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    to.AddArray(array)


def _in_space(vectors: FloatArray) -> FloatArray:
    return np.column_stack([vectors, np.zeros(len(vectors))])
