"""Scene files as TOML: where they are, what they hold, keys put in place of theirs, and TOML text written."""

from __future__ import annotations

import json
import os
import re
import tomllib
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpgrains.errors import SceneError
from warpgrains.scene import checks
from warpgrains.scene.fields import SECTIONS

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

Table = dict[str, Any]

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
SHIPPED = {"scene": "", "sweep": "sweeps"}
"""Where the shipped files of each kind are, seen from the folder of the scenes."""


def shipped_scenes() -> list[str]:
    """Return the names of the scenes that come with the package."""
    return shipped("scene")


def shipped(kind: str) -> list[str]:
    """Return the names of the scenes, or of the sweeps, that come with the package."""
    names = (entry.name for entry in _folder(kind).iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml"))


def read_document(name_or_path: str | os.PathLike[str]) -> Table:
    """Return the sections of a scene in a file, or of a shipped scene, as they are written there."""
    return parse_toml(read_text(Path(name_or_path), "scene"), name_or_path)


def read_text(path: Path, kind: str) -> str:
    """Return the text of a scene or a sweep, a file or the name of a shipped one; SceneError if none."""
    source: Path | Traversable = path
    if not _is_there(path):
        known = shipped(kind)
        if str(path) not in known:
            raise checks.unknown(f"{kind}, neither a file nor a shipped one,", str(path), known)
        source = _folder(kind) / f"{path}.toml"
    try:
        return source.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(f"{path} cannot be read: {error}") from None


def parse_toml(text: str, path: str | os.PathLike[str]) -> Table:
    """Return what a TOML text of the file `path` holds."""
    try:
        document = tomllib.loads(text)
        require_toml_numbers(document)
    except (ValueError, RecursionError) as error:
        raise SceneError(f"{path} is not TOML: {error}") from None
    return document


def parameters_text(scene: Scene) -> str:
    """Return all of a scene as TOML that is not its grains."""
    tables: Table = {"walls": [wall.table for wall in scene.walls]} if scene.walls else {}
    for section, names in SECTIONS.items():
        values = {name: getattr(scene, name) for name in names}
        tables[section] = {name: value for name, value in values.items() if value is not None}
    return toml_text(tables)


def read_parameters(text: str) -> dict[str, Any]:
    """Return the fields of a scene that `parameters_text` has written."""
    document = parse_toml(text, "the recording's scene")
    walls = {"walls": document.pop("walls")} if "walls" in document else {}
    return walls | {name: value for table in document.values() for name, value in table.items()}


def override_key(document: Table, override: str) -> None:
    """Put the value of "section.key=value" in its place; a bare word stands for itself."""
    target, equals, value = override.partition("=")
    section, dot, key = target.strip().partition(".")
    if not (equals and dot and key):
        raise SceneError(f"override {override!r}: it must be section.key=value, such as physics.drag=0.1")
    try:
        parsed = tomllib.loads(f"value = {value}")
        require_toml_numbers(parsed)
    except (ValueError, RecursionError):
        parsed = {"value": value.strip()} if value.strip().replace("-", "_").isidentifier() else {}
    if parsed.keys() != {"value"}:
        raise SceneError(f"override {override!r}: {value!r} is not a TOML value")
    table = document.setdefault(section, {})
    if isinstance(table, dict):
        table[key] = parsed["value"]


def _is_there(path: Path) -> bool:
    try:
        return path.exists() and not path.is_dir()
    except (OSError, ValueError):  # no file can have such a name
        return False


def _folder(kind: str) -> Traversable:
    return files("warpgrains.scenes") / SHIPPED[kind]


def toml_text(document: Table) -> str:
    """Return a document as TOML: its sections in order, a line a key; the same doubles are read back.

    Raises
    ------
    SceneError
        A value is of a kind that no scene has, such as a date.
    """
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
        case dict():
            pairs = (f"{_key(key)} = {toml_value(item)}" for key, item in value.items())
            return f"{{{', '.join(pairs)}}}"
    raise SceneError(f"{value!r} is a {type(value).__name__}: no scene holds one")


def require_toml_numbers(value: Any) -> None:
    """Raise ValueError if a whole number is larger than any of TOML, which has 64 bits for them."""
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
    """Return a text in quotes, in ASCII, on one line."""
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        raise SceneError(f"{text!r} is no text: it cannot be written")
    letters = (f"\\U{ord(letter):08x}" if letter > "\uffff" else json.dumps(letter)[1:-1] for letter in text)
    return f'"{"".join(letters)}"'.replace("\x7f", "\\u007f")
