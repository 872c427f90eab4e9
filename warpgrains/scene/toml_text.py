"""TOML text of a scene, which the standard library reads but does not write."""

import json
import re
from typing import Any

from warpgrains.errors import SceneError

_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(document: dict[str, Any]) -> str:
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


def _lines(table: dict[str, Any]) -> str:
    return "".join(f"{_key(key)} = {toml_value(value)}\n" for key, value in table.items())


def _key(key: str) -> str:
    return key if _BARE_KEY.fullmatch(key) else _quoted(key)


def _quoted(text: str) -> str:
    """Return a text in quotes, in ASCII, on one line."""
    if any("\ud800" <= letter <= "\udfff" for letter in text):
        raise SceneError(f"{text!r} is no text: it cannot be written")
    letters = (f"\\U{ord(letter):08x}" if letter > "\uffff" else json.dumps(letter)[1:-1] for letter in text)
    return f'"{"".join(letters)}"'.replace("\x7f", "\\u007f")
