"""Files of grains, to which `grains.file` of a scene file refers.

An `.npz` file holds the array `position` (n, 2), and any of `velocity` (n, 2), `radius`, `mass` and `spin`,
shape (n,).
A `.csv` file names its columns in the first line: `x` and `y`, and any of `vx` and `vy`, `radius`, `mass`
and `spin`.
"""

import csv
import io
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains.arrays import FloatArray
from warpgrains.errors import InputError
from warpgrains.files import open_regular, suffix_of
from warpgrains.scene import checks

FIELDS = ("position", "velocity", "radius", "mass", "spin")
COLUMNS = ("x", "y", "vx", "vy", "radius", "mass", "spin")

_SEPARATORS = {";": "semicolons", "\t": "tabs", " ": "spaces"}


def read_grains(folder: Path, name: Any) -> dict[str, FloatArray]:
    """Read `position` and any other arrays of a file of grains; `folder` is that of the scene file.

    Raises
    ------
    InputError
        The file cannot be read or holds no grains.
    """
    grains = _read(folder, name)
    if "position" not in grains:
        raise InputError(
            f"grains.file {name!r} has no positions: it needs an array position, or columns x and y"
        )
    return grains


def is_file_of_radii(radius: Any) -> bool:
    """Return whether a radius is a table ``{file = NAME}``, see `read_radii`."""
    return isinstance(radius, dict) and "file" in radius


def read_radii(folder: Path, table: dict[str, Any]) -> FloatArray:
    """Read the radii [m] of the file that ``{file = NAME}`` names; its other columns are ignored.

    Raises
    ------
    InputError
        The file cannot be read or holds no radii.
    """
    if len(table) > 1:
        raise InputError(f"grains.radius is {table!r}: next to file it takes no other key")
    grains = _read(folder, table["file"])
    if "radius" not in grains:
        raise InputError(f"grains.radius: file {table['file']!r} has no radii")
    return checks.positive_per_grain("radius", grains["radius"], np.size(grains["radius"]))


def _read(folder: Path, name: Any) -> dict[str, FloatArray]:
    if not isinstance(name, str):
        raise InputError(f"grains.file is {name!r}: it must be the name of a file")
    path = folder / name
    readers = {".npz": _read_npz, ".csv": _read_csv}
    if suffix_of(path) not in readers:
        raise InputError(f"grains.file is {name!r}: it must end in .npz or .csv")
    try:
        grains = readers[suffix_of(path)](path)
    except InputError as error:
        raise InputError(f"grains.file {name!r}: {error}") from None
    except Exception as error:  # readers of untrusted files raise exceptions of any type
        raise InputError(f"grains.file {name!r} cannot be read: {error}") from None
    return grains


def _read_npz(path: Path) -> dict[str, FloatArray]:
    with open_regular(path) as stream, np.load(stream, allow_pickle=False) as archive:
        for name in archive.files:
            checks.one_of("array", name, FIELDS)
        return dict(archive)


def _read_csv(path: Path) -> dict[str, FloatArray]:
    with open_regular(path) as file:
        reader = csv.reader(io.TextIOWrapper(file, encoding="utf-8-sig", newline=""))
        header = [name.strip() for name in next(reader, [])]
        if not header:
            raise InputError("the first line must name the columns")
        for separator, name in _SEPARATORS.items():
            if len(header) == 1 and separator in header[0]:
                raise InputError(f"its columns are separated by {name}: they must be separated by commas")
        for name in header:
            checks.one_of("column", name, COLUMNS)
        values = np.array([_numbers(row, header, reader.line_num) for row in reader if row])
    column = dict(zip(header, values.reshape(-1, len(header)).T, strict=True))
    grains: dict[str, FloatArray] = {name: column[name] for name in column if name in FIELDS}
    for field, (x, y) in {"position": ("x", "y"), "velocity": ("vx", "vy")}.items():
        if (x in column) != (y in column):
            raise InputError(f"column {x if y in column else y!r} is missing")
        if x in column:
            grains[field] = np.column_stack([column[x], column[y]])
    return grains


def _numbers(row: list[str], header: list[str], line: int) -> list[float]:
    if len(row) != len(header):
        raise InputError(f"line {line} has {len(row)} values for {len(header)} columns")
    try:
        return [float(value) for value in row]
    except ValueError:
        raise InputError(f"line {line} holds {row}: every value must be a number") from None
