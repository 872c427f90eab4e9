"""Reader of scene files and of the files of grains that they name. It returns the fields of a `Scene`.

``warpgrains scenes NAME`` lists the keys of scene files. An `.npz` file of grains holds the array `position`
(n, 2), and any of `velocity` (n, 2), `radius`, `mass` and `spin`, shape (n,). A `.csv` file names its columns
in the first line: `x` and `y`, and any of `vx` and `vy`, `radius`, `mass` and `spin`.
"""

import csv
import inspect
import io
import re
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

import numpy as np

from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.described import described_fields
from warpgrains.base.errors import InputError
from warpgrains.base.files import open_regular, suffix_of
from warpgrains.scene.fields import KEY_OF, OF_GRAINS, SECTIONS
from warpgrains.scene.layouts import LAYOUTS, Placement
from warpgrains.scene.toml import LISTS, Table, fields_of_sections, numbered_key, overridden, parse_toml
from warpgrains.space.geometry import require_squares
from warpgrains.space.region import Region
from warpgrains.walls.annulus import Annulus
from warpgrains.walls.box import OF_SIDES, SIDES, Box, checked_domain
from warpgrains.walls.kinds import WRITTEN_KINDS, checked_walls
from warpgrains.walls.rim import Rim
from warpgrains.walls.wall import Wall

SOURCES = {
    "layout": f"Where grains start: the name of a layout, {', '.join(LAYOUTS)}, which has more keys; or:",
    "position": "centers of the grains [m], a list of pairs; or:",
    "file": "name of an .npz or .csv file of grains, relative to the scene file. It has arrays position,"
    " velocity, radius, mass and spin, or columns x, y, vx, vy, radius, mass and spin, positions at least.",
}
"""Keys that give the positions of the grains; a scene file has exactly one of them."""
PROPERTIES = {
    "mass": "Mass of every grain, or a list [kg]; or:",
    "density": "mass by area [kg/m2].",
    "velocity": "Velocity of all grains at the start, or a list [m/s]. By default all rest.",
    "spin": "Angular velocity of all grains at the start, or a list [rad/s]. By default none rotates.",
}
"""Keys of `[grains]`, with their meaning, for properties other than positions and radii."""

DOMAINS = {"annulus": ("kind", *SECTIONS["domain"]), "box": ("kind", *described_fields(Box))}
"""Keys of `[domain]` for each kind of domain."""

_COLUMNS = ("x", "y", "vx", "vy", "radius", "mass", "spin")
_SEPARATORS = {";": "semicolons", "\t": "tabs", " ": "spaces"}


def scene_document(text: str, path: Path, overrides: Iterable[str] = ()) -> tuple[Table, Table]:
    """Parse the text of a scene file and apply overrides "section.key=value".

    Return the document, and the fields `name` (of the file) and `text` (with the overrides) of the scene.
    """
    document = parse_toml(text, path)
    for override in overrides:
        document = overridden(document, override)
        text += f"\n# --set {' '.join(override.split())}"
    texts = {"name": path.stem, "text": text}  # file names need not be UTF-8
    return document, {field: value.encode(errors="replace").decode() for field, value in texts.items()}


def require_key(section: str, key: str) -> None:
    """Raise InputError unless scene files may have this key in this section."""
    if section == "walls":
        of_walls = set().union(*(kind.keys() for kind in WRITTEN_KINDS.values()))
        return _refuse_unknown_keys(section, [numbered_key(section, key)[1]], ("kind", *of_walls))
    checks.one_of("section", section, [*SECTIONS, "grains", "walls"])
    of_layouts = {name for layout in LAYOUTS.values() for name in keyword_parameters(layout)}
    known = {**SECTIONS, "domain": domain_keys()}.get(section, [*SOURCES, *PROPERTIES, *of_layouts])
    side, dot, of_side = key.partition(".")
    if dot and side in SIDES:
        checks.one_of(f"key of {section}.{side}", of_side.partition(".")[0], OF_SIDES)
    else:
        _refuse_unknown_keys(section, [key], known)


def domain_keys(kinds: Iterable[str] = DOMAINS) -> list[str]:
    """Return the keys of `[domain]` for kinds of domains."""
    return list(dict.fromkeys(key for kind in kinds for key in DOMAINS[kind]))


def document_fields(document: Table, folder: Path) -> Table:
    """Return the fields of a scene except name and text. Files of grains are relative to `folder`."""
    fields = section_fields(document)
    boundary: Annulus | Box | None = checked_domain("domain", fields.get("domain"))
    if boundary is None and "radius_out" not in fields:
        raise InputError('domain.radius_out is missing; or give domain.kind = "box", with x and y')
    if "grains" not in document:
        raise InputError(f"section [grains] is missing: it needs one of {', '.join(SOURCES)}")
    boundary = boundary or Annulus(
        checks.not_negative("radius_in", fields.get("radius_in", 0.0)),
        checks.positive("radius_out", fields["radius_out"]),
    )
    require_squares(boundary.size, boundary.reach)
    time = checks.number("time", fields.get("time", 0.0))
    walls = (wall.starting(time).at(time) for wall in boundary.completed(fields["walls"]))
    inside = tuple(wall for wall in walls if not isinstance(wall, Rim))
    return fields | _grains(document["grains"], boundary.space, inside, folder)


def section_fields(document: Table) -> Table:
    """Return the fields of all sections except `[grains]`: walls are checked, other values are not."""
    fields: Table = {"walls": checked_walls("walls", document.get("walls", []))}
    for section, table in document.items():
        if section in KEY_OF and section not in SECTIONS and not isinstance(table, dict):
            own = KEY_OF[section].partition(".")[0]
            raise InputError(f"{section} stands above all sections: put it into [{own}]")
        checks.one_of("section", section, [*SECTIONS, "grains", *LISTS])
        if section in LISTS:
            fields.setdefault(section, table)
            continue
        if not isinstance(table, dict):
            raise InputError(f"{section} is {table!r}: it must be a section, [{section}]")
        if section in SECTIONS:
            known: Iterable[str] = SECTIONS[section]
            if section == "domain":
                kind = checks.one_of("domain.kind", table.get("kind", "annulus"), DOMAINS)
                known, (other,) = DOMAINS[kind], DOMAINS.keys() - {kind}
                for key in [key for key in table if key in DOMAINS[other] and key not in known]:
                    raise InputError(f'domain.{key} needs domain.kind = "{other}", and it is "{kind}"')
            _refuse_unknown_keys(section, table, known)
            fields |= fields_of_sections({section: table})
    return fields


def _grains(table: Table, space: Region, walls: tuple[Wall, ...], folder: Path) -> Table:
    """Return position, radius and mass of the grains from `[grains]`, and velocity and spin if given."""
    source = checks.only_one("[grains]", table, SOURCES)
    own = {key: value for key, value in table.items() if key not in PROPERTIES and key != "layout"}
    if source == "layout":
        if is_file_of_radii(own.get("radius")):
            own["radius"] = read_radii(folder, own["radius"])
        position, radius = _lay_out(table["layout"], own, space, walls)
        grains: Table = {"position": position, "radius": radius}
    else:
        _refuse_unknown_keys("grains", own, (source, "radius", *PROPERTIES))
        if isinstance(own.get("radius"), dict):
            told = 'only layout = "random" draws radii, so give a number or a list'
            raise InputError(f"grains.radius is {checks.shown(own['radius'])}: {told}")
        grains = {"position": own["position"]} if "position" in own else read_grains(folder, own["file"])
        _set_once(grains, own, "radius")
    grains["position"] = checks.vectors("position", grains["position"])
    for name in ("velocity", "spin"):
        _set_once(grains, table, name)
    velocity = grains.get("velocity")
    if np.iterable(velocity) and not any(np.iterable(component) for component in velocity):  # one for all
        grains["velocity"] = np.tile(checks.vector("grains.velocity", velocity), (len(grains["position"]), 1))
    if "radius" not in grains:
        raise InputError("grains.radius is missing: give the radius of all grains, or a list [m]")
    _set_once(grains, _with_mass(table, grains), "mass")
    if "mass" not in grains:
        raise InputError("grains.mass or grains.density is missing: give one of them")
    return grains


def _lay_out(layout: Any, parameters: Table, space: Region, walls: tuple[Wall, ...]) -> Placement:
    """Call a layout with `parameters`; raise InputError if one is unknown or missing."""
    function = LAYOUTS[checks.one_of("grains.layout", layout, LAYOUTS)]
    own = keyword_parameters(function)
    _refuse_unknown_keys("grains", parameters, (*own, *PROPERTIES))
    for name, parameter in own.items():
        if parameter.default is parameter.empty and name not in parameters:
            raise InputError(f"grains.{name} is missing: layout {layout!r} needs it")
    avoided = (walls,) if "walls" in inspect.signature(function).parameters else ()
    return function(space, *avoided, **parameters)


@cache
def keyword_parameters(layout: Callable[..., Placement]) -> dict[str, inspect.Parameter]:
    """Return the keyword parameters of a layout, which are its keys of `[grains]`."""
    parameters = inspect.signature(layout).parameters
    keys = {name: own for name, own in parameters.items() if own.kind is own.KEYWORD_ONLY}
    for name in keys:
        if name in SOURCES or name in PROPERTIES:
            raise InputError(
                f"layout {layout.__name__!r} has the parameter {name}: choose another name, because"
                f" grains.{name} is a key of every layout"
            )
    return keys


def _with_mass(table: Table, grains: Table) -> Table:
    """Return the table {"mass": masses} from the density in `table`; without a density, return `table`.

    `grains` holds the radii [m]. InputError if both mass and density are given.
    """
    if "density" not in table:
        return table
    if "mass" in table:
        raise InputError("[grains] has mass and density: give only one")
    radius = checks.positive_per_grain("radius", grains["radius"], len(grains["position"]))
    return {"mass": checks.positive("grains.density", table["density"]) * np.pi * radius**2}


def _set_once(grains: Table, table: Table, key: str) -> None:
    if key in table:
        if key in grains:
            raise InputError(f"grains.{key} is given twice, in the scene and in its file: remove one")
        grains[key] = table[key]


def _refuse_unknown_keys(section: str, table: Iterable[str], known: Iterable[str]) -> None:
    known = list(known)
    for key in table:
        elsewhere = key in KEY_OF and not KEY_OF[key].startswith(f"{section}.")
        if key not in known and elsewhere and not get_close_matches(key, known):
            raise InputError(f"unknown key in [{section}] {key!r}: did you mean {KEY_OF[key]}?")
        checks.one_of(f"key in [{section}]", key, known)


def read_grains(folder: Path, name: Any) -> dict[str, FloatArray]:
    """Read `position` and any other arrays of a file of grains; `folder` is that of the scene file."""
    grains = _grains_of_file(folder, name)
    if "position" not in grains:
        raise InputError(
            f"grains.file {name!r} has no positions: it needs an array position, or columns x and y"
        )
    return grains


def is_file_of_radii(radius: Any) -> bool:
    """Return whether a radius is a table ``{file = NAME}``, see `read_radii`."""
    return isinstance(radius, dict) and "file" in radius


def read_radii(folder: Path, table: dict[str, Any]) -> FloatArray:
    """Read the radii [m] of the file that ``{file = NAME}`` names; its other columns are ignored."""
    if len(table) > 1:
        raise InputError(f"grains.radius is {table!r}: next to file it takes no other key")
    grains = _grains_of_file(folder, table["file"])
    if "radius" not in grains:
        raise InputError(f"grains.radius: file {table['file']!r} has no radii")
    return checks.positive_per_grain("radius", grains["radius"], np.size(grains["radius"]))


def _grains_of_file(folder: Path, name: Any) -> dict[str, FloatArray]:
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
    with open_regular(path) as stream:
        if not is_zipfile(stream):
            raise InputError("it is not an archive of arrays, as numpy.savez writes it")
        stream.seek(0)
        archive = np.load(stream, allow_pickle=False)
        for name in archive.files:
            checks.one_of("array", name, OF_GRAINS)
        return dict(archive)


def _read_csv(path: Path) -> dict[str, FloatArray]:
    with open_regular(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig")
        header = [name.strip() for name in next(csv.reader([next(text, "")]), [])]
        lines = {number: line for number, line in enumerate(text, 2) if line.strip()}
    if not header:
        raise InputError("the first line must name the columns")
    for separator, name in _SEPARATORS.items():
        if len(header) == 1 and separator in header[0]:
            raise InputError(f"its columns are separated by {name}: they must be separated by commas")
    for name in header:
        checks.one_of("column in line 1", name, _COLUMNS)
    column = np.zeros(0, [(name, np.float64) for name in header])
    if lines:
        try:
            column = np.loadtxt([*lines.values()], column.dtype, None, ",", quotechar='"', ndmin=1)
        except ValueError as error:
            raise InputError(_complaint(str(error), header, [*lines])) from None
    grains: dict[str, FloatArray] = {name: column[name] for name in header if name in OF_GRAINS}
    for field, (x, y) in {"position": ("x", "y"), "velocity": ("vx", "vy")}.items():
        if (x in header) != (y in header):
            raise InputError(f"column {x if y in header else y!r} is missing")
        if x in header:
            grains[field] = np.column_stack([column[x], column[y]])
    return grains


def _complaint(error: str, header: list[str], lines: list[int]) -> str:
    """Translate an error of NumPy's reader: name the line of the file and the column instead of indices.

    `header` has the names of the columns, `lines` the number of the line of each row.
    """
    if found := re.search(r"string (.*) to float64 at row (\d+), column (\d+)", error):
        where = f"line {lines[int(found[2])]}, column {header[int(found[3]) - 1]!r}"
        return f"{where}: {found[1]} is not a number"
    if found := re.search(r"(\d+) were found at row (\d+)", error):
        return f"line {lines[int(found[2]) - 1]} has {found[1]} values for {len(header)} columns"
    return error
