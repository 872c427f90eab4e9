"""Export of recordings for ParaView and pyvista: grains, contacts and walls, as polydata of VTK in XML."""

import re
from base64 import b64encode
from contextlib import ExitStack
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import quoteattr
from zlib import compress

import numpy as np

from warpgrains.base.arrays import FloatArray
from warpgrains.base.errors import InputError
from warpgrains.base.files import draft_of, make_folder, require_writable_path, resolve_link, write_atomically
from warpgrains.base.locks import Lock
from warpgrains.drawing.chains import all_contacts, contact_lines, cut
from warpgrains.drawing.shapes import wall_mesh
from warpgrains.usd.recording import Recording, painter_of

Arrays = dict[str, np.ndarray]
_FRAME = re.compile(r"(\.draft\.)?([a-z]+-)?\d{4,}\.vtp")  # drafts remain where an export was killed


def export(recording: str | Path, output: str | Path) -> int:
    """Write the frames of a recording as VTK files, and return the number of frames.

    RUN.pvd lists the times and, for each time, a file of each block, such as ``RUN/grains-0000.vtp``. Blocks:

    - ``Grains``: points with vertex cells, wrapped into a periodic box and followed by images of the grains
      that cross periodic sides. Point data are `grain` (the number), `radius` [m], `mass` [kg],
      `velocity` [m/s], and what else is recorded: `speed` [m/s], `pressure` [N/m], and with friction `spin`
      [rad/s], `angle` [rad] and `mobilized`; where grains come and go, `id`, the number of birth.
    - ``Contacts``, if recorded: lines between centers, or from a center to a wall. Cell data are `force` [N],
      with friction `tangential_force` [N], and `grain` and `other`: another grain, -1 for the outer wall, -2
      for the inner one, or -3, -4, ... for those of `Scene.walls`.
    - ``Walls``: polygons, as drawn. If no wall moves, there is one file.
    """
    output = Path(output)
    require_writable_path("output", output, ".pvd")
    source = Recording(recording)
    with Lock(output):
        _write(source, output)
    return len(source)


def _write(source: Recording, output: Path) -> None:
    """Write the files of all frames into a folder next to `output`, and then `output`, the list of files."""
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
                drafts.enter_context(draft_of(latest[name])).write_bytes(data)
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


def _blocks(source: Recording, k: int) -> dict[str, bytes]:
    """Return the VTK files of frame k: content by name, "Grains", "Contacts" and "Walls".

    There are contacts only if forces are recorded. If no wall moves, only frame 0 has walls.
    """
    frame = source.frame(k, contacts=source.has_forces)
    (places, number), scene = frame.images, frame.scene
    own: Arrays = {**frame.recorded, "radius": scene.radius, "mass": scene.mass}
    own |= {} if frame.births is None else {"id": frame.births}
    own |= {"spin": frame.spin, "angle": frame.angle} if scene.has_friction else {}
    of_grain: Arrays = dict(sorted(own.items())) | {
        "grain": np.arange(frame.n),
        "velocity": _in_space(frame.velocity),
    }
    points = np.arange(len(places))[:, np.newaxis]
    images = {name: values[number] for name, values in of_grain.items()}
    found = {"Grains": _vtp(places, "Verts", points, of_points=images)}
    if source.has_forces:
        pair, force, tangential = all_contacts(frame)
        start, end, _ = contact_lines(frame, pair)
        start, end, contact = cut(scene.period, start, end)
        ends = np.stack([start, end], axis=1).reshape(-1, 2)
        carried = {"force": force} | ({"tangential_force": tangential} if scene.has_friction else {})
        of_contact = {"grain": pair[contact, 0], "other": pair[contact, 1]}
        of_contact |= {name: own[contact] for name, own in carried.items()}
        found["Contacts"] = _vtp(ends, "Lines", np.arange(len(ends)).reshape(-1, 2), of_cells=of_contact)
    painter = painter_of(source)
    moved = painter.moved_walls(scene, frame.time)
    meshes = [wall_mesh(band) for band in (painter.walls | moved).values()]
    if meshes and (moved or k == 0):
        first = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
        corners = [mesh.corners.reshape(-1, 4) + of for mesh, of in zip(meshes, first, strict=False)]
        places = np.concatenate([mesh.points[:, :2] for mesh in meshes])
        found["Walls"] = _vtp(places, "Polys", np.concatenate(corners))
    return found


def _vtp(
    places: FloatArray,
    kind: Literal["Verts", "Lines", "Polys"],
    corners: np.ndarray,
    of_points: Arrays | None = None,
    of_cells: Arrays | None = None,
) -> bytes:
    """Return the content of a VTK file with points at `places` [m] and c cells, which are of one kind.

    `corners` has the indices of the points of each cell, shape (c, k). `of_points` and `of_cells` are data by
    name.
    """
    sections = {
        "PointData": of_points or {},
        "CellData": of_cells or {},
        "Points": {"Points": _in_space(places)},
        kind: {
            "connectivity": corners.ravel(),
            "offsets": corners.shape[1] * np.arange(1, len(corners) + 1),
        },
    }
    lines = [
        '<?xml version="1.0"?>',
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64"'
        ' compressor="vtkZLibDataCompressor"><PolyData>',
        f'<Piece NumberOfPoints="{len(places)}" NumberOf{kind}="{len(corners)}">',
    ]
    for section, arrays in sections.items():
        lines += [f"<{section}>", *map(_array, arrays, arrays.values()), f"</{section}>"]
    return "\n".join([*lines, "</Piece></PolyData></VTKFile>", ""]).encode()


def _array(name: str, values: np.ndarray) -> str:
    """Return an array as the XML element `DataArray` of this name, compressed in one block, in base 64."""
    data = values.astype(values.dtype.newbyteorder("<")).tobytes()
    block = compress(data) if data else b""
    header = np.array([1, len(data), 0, len(block)] if data else [0, 0, 0], "<u8")
    kind = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind]
    return (
        f'<DataArray type="{kind}{8 * values.itemsize}" Name="{name}" format="binary"'
        f' NumberOfComponents="{values.shape[1] if values.ndim > 1 else 1}">'
        f"{b64encode(header.tobytes()).decode()}{b64encode(block).decode()}</DataArray>"
    )


def _in_space(vectors: FloatArray) -> FloatArray:
    return np.column_stack([vectors, np.zeros(len(vectors))])
