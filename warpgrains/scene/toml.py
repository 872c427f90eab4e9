"""Scene files as TOML text: finding, parsing, overriding and writing them."""

from __future__ import annotations

import json
import os
import re
import tomllib
from difflib import get_close_matches
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpgrains.base import checks
from warpgrains.base.errors import InputError
from warpgrains.base.files import read_regular
from warpgrains.scene.fields import SECTIONS

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

Table = dict[str, Any]

_LONGEST = 2**28  # largest size of a file [bytes]
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_VALUE = 'a number such as 0.5 (no unit), true, a "text" in quotes or a [list]'
_TOLD = {
    "Cannot declare": "this section stands twice, so put its keys below the first one",
    "Cannot overwrite": "this key stands twice, so remove one",
    "Cannot mutate": "this section already stands above as a value, so write it only once",
    "Expected '='": "it must be key = value, [section] or # comment",
    "Expected newline": f"after = must stand {_VALUE}",
    "Invalid value": f"after = must stand {_VALUE}",
    "Illegal character": "a text ends on its line, with the quote with which it begins",
    "Invalid statement": "it must be key = value, [section] or # comment",
    "Unclosed array": "a list needs commas between its values, and a ] at the end",
    "Unescaped": "in a text, write / or \\\\ for \\",
}
"""Explanations of syntax errors, by the text with which the message of tomllib begins."""
LISTS = {"walls": "wall", "sources": "source", "sinks": "sink"}
"""Lists of tables in scene files, such as [[walls]], and the name of what one table describes."""
SHIPPED = {"scene": "", "sweep": "sweeps"}
"""Folder of the shipped files by kind, "scene" or "sweep", relative to the folder of the scenes."""


def shipped_scenes() -> list[str]:
    """Return the names of the scenes that are part of the package."""
    return shipped("scene")


def shipped(kind: str) -> list[str]:
    """Return the names of the scenes, or of the sweeps, that are part of the package."""
    names = (entry.name for entry in _folder(kind).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def shipped_text(kind: str, name: str) -> str:
    """Return the text of a scene, or of a sweep, that is part of the package."""
    return (_folder(kind) / f"{name}.toml").read_text(encoding="utf-8")


def read_text(path: Path, kind: str) -> str:
    """Return the text of a file, or of a shipped file by its name; `kind` is "scene" or "sweep"."""
    if not _exists(path):
        if kind == "sweep" and str(path) in shipped("scene"):
            raise InputError(
                f'{checks.shown(str(path))} is a scene: give a sweep file with scene = "{path}" and [axes]'
            )
        if os.path.isdir(path) and str(path) not in shipped(kind):
            told = "`warpgrains batch` takes a folder of scenes, other commands take a file"
            raise InputError(f"{kind} {checks.shown(str(path))} is a folder: {told}")
        if path.suffix == ".toml" or len(path.parts) > 1:
            nearest = get_close_matches(path.stem, shipped(kind), n=1)
            told = (
                f"did you mean the shipped {nearest[0]!r}?"
                if nearest
                else "`warpgrains scenes` lists shipped ones"
            )
            raise InputError(f"{kind} file {checks.shown(str(path))} does not exist: {told}")
        checks.one_of(f"{kind}, neither a file nor a shipped one,", str(path), shipped(kind))
        return shipped_text(kind, str(path))
    try:
        return read_regular(path, _LONGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        told = f"it must be a {kind} file; view and plot show recordings"
        raise InputError(f"{path} is not UTF-8 text (byte {error.start}): {told}") from None


def parse_toml(text: str, path: str | os.PathLike[str]) -> Table:
    """Return the content of TOML text; `path` is named in errors."""
    try:
        document = tomllib.loads(text)
        require_toml_numbers(document)
    except (ValueError, RecursionError) as error:
        told = "" if str(path).endswith(".toml") else ": give a file .toml"
        raise InputError(f"{path} is not TOML{told}: {_reason(str(error), text)}") from None
    return document


def _reason(error: str, text: str) -> str:
    """Return an error of tomllib with the number and content of the line in `text`, explained by `_TOLD`."""
    found = re.fullmatch(r"(.*) \(at (?:line (\d+), column \d+|end of document)\)", error, re.DOTALL)
    if found is None:
        return error
    lines = text.split("\n")
    number = int(found[2] or len(lines))
    if error.startswith("Unclosed array"):
        opened = (k for k in range(number, 0, -1) if lines[k - 1].count("[") > lines[k - 1].count("]"))
        number = next(opened, number)
    told = next((told for start, told in _TOLD.items() if error.startswith(start)), found[1])
    return f"line {number}, {checks.shown(lines[number - 1].strip())}: {told}"


def parameters_text(scene: Scene) -> str:
    """Return all fields of a scene except its grains, as TOML."""
    listed: dict[str, tuple[Any, ...]] = {
        "walls": scene.written_walls,
        "sources": scene.sources,
        "sinks": scene.sinks,
    }
    tables: Table = {name: [one.table for one in own] for name, own in listed.items() if own}
    for section, names in SECTIONS.items():
        values = {name: getattr(scene, name) for name in names}
        tables[section] = {
            name: getattr(value, "table", value) for name, value in values.items() if value is not None
        }
    if scene.domain:
        tables["domain"] = scene.domain.table
    return toml_text(tables)


def read_parameters(text: str) -> dict[str, Any]:
    """Return the fields of a scene from the text of `parameters_text`."""
    document = parse_toml(text, "the recording's scene")
    listed = {name: document.pop(name) for name in LISTS if name in document}
    return listed | fields_of_sections(document)


def fields_of_sections(document: Table) -> dict[str, Any]:
    """Return the fields of a scene in the sections of a document. The keys of a box become field `domain`."""
    fields: dict[str, Any] = {}
    for section, table in document.items():
        own = {key: value for key, value in table.items() if (section, key) != ("domain", "kind")}
        is_box = section == "domain" and table.get("kind", "annulus") == "box"
        fields |= {"domain": own} if is_box else own
    return fields


def overridden(document: Table, override: str) -> Table:
    """Return a document with "section.key=value" applied. A value that is a bare word becomes a string."""
    target, equals, value = override.partition("=")
    told = f"override {checks.shown(override)}"
    if not equals or not all(target.strip().partition(".")):
        raise InputError(f"{told}: it must be section.key=value, such as physics.drag=0.1")
    try:
        parsed = tomllib.loads(f"value = {value}")
        require_toml_numbers(parsed)
    except (ValueError, RecursionError):
        parsed = {"value": value.strip()} if value.strip().replace("-", "_").isidentifier() else {}
    if parsed.keys() != {"value"}:
        raise InputError(f"{told}: after = must stand {_VALUE}")
    try:
        return with_key(document, target.strip(), parsed["value"])
    except InputError as error:
        raise InputError(f"{told}: {error}") from None


def with_key(document: Table, key: str, value: Any) -> Table:
    """Return a document with a new value for a key, such as "domain.top.mass" or "walls.0.friction"."""
    section, _, name = key.partition(".")
    table = document.get(section, {})
    if section in LISTS:
        number, own = numbered_key(section, name)
        if not isinstance(table, list) or not number < len(table) or not isinstance(table[number], dict):
            has = (
                f"{len(table)} of them, the last is {section}.{len(table) - 1}"
                if table
                else "none, so add such a table to its file"
            )
            what = f"{LISTS[section]} {number} in [[{section}]]"
            raise InputError(f"{key}: there is no {what}: the scene has {has}")
        return {**document, section: [*table[:number], {**table[number], own: value}, *table[number + 1 :]]}
    if not isinstance(table, dict):
        raise InputError(f"{section} is {table!r}: it must be a section, [{section}]")
    return {**document, section: with_key(table, name, value) if "." in name else {**table, name: value}}


def numbered_key(section: str, name: str) -> tuple[int, str]:
    """Split a key of a list of tables: "0.friction" in section "walls" gives the number 0 and "friction"."""
    number, _, key = name.partition(".")
    if not (number.isascii() and number.isdigit() and key):
        raise InputError(f"{section}.{name}: it must be {section}.NUMBER.KEY, such as walls.0.friction")
    return int(number), key


def _exists(path: Path) -> bool:
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):  # no file can have such a name
        return False


def _folder(kind: str) -> Traversable:
    return files("warpgrains.scenes") / SHIPPED[kind]


def toml_text(document: Table) -> str:
    """Return a document as TOML, one line a key; floats are read back as the same doubles."""
    bare = {key: value for key, value in document.items() if not isinstance(value, dict)}
    parts = [_lines(bare)] if bare else []
    parts += [f"[{_key(key)}]\n{_lines(table)}" for key, table in document.items() if isinstance(table, dict)]
    return "\n".join(parts)


def toml_value(value: Any) -> str:
    """Return one value as TOML, on one line."""
    match value:
        case bool():
            return str(value).lower()
        case int() | float():
            return repr(value)
        case str():
            return _quoted(value)
        case dict():
            return f"{{{', '.join(f'{_key(key)} = {toml_value(own)}' for key, own in value.items())}}}"
        case list() | tuple():
            return f"[{', '.join(map(toml_value, value))}]"
    raise InputError(f"{value!r} is a {type(value).__name__}: a scene file cannot hold it")


def require_toml_numbers(value: Any) -> None:
    """Raise ValueError if an integer does not fit in 64 bits, the range of TOML."""
    match value:
        case dict():
            require_toml_numbers(list(value.values()))
        case list():
            for item in value:
                require_toml_numbers(item)
        case int() if not -(2**63) <= value < 2**63:
            raise ValueError("a whole number has more than 64 bits")


def _lines(table: Table) -> str:
    return "".join(f"{_key(key)} = {toml_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _quoted(key)


def _quoted(text: str) -> str:
    """Return a text as a quoted TOML string on one line; characters outside ASCII are escaped."""
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        raise InputError(f"{text!r} is not valid text: it cannot be written")
    letters = (f"\\U{ord(letter):08x}" if letter > "\uffff" else json.dumps(letter)[1:-1] for letter in text)
    return f'"{"".join(letters)}"'.replace("\x7f", "\\u007f")
