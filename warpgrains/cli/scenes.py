"""`warpgrains scenes` and `warpgrains init`: list, show and explain scenes, or write a new one."""

import inspect
import re
import shutil
import textwrap
from argparse import Namespace
from collections.abc import Callable, Iterable, Iterator
from dataclasses import MISSING, Field
from pathlib import Path
from typing import Any, NamedTuple, Self

from warpgrains.base import checks
from warpgrains.base.console import in_columns
from warpgrains.base.described import described_fields
from warpgrains.base.errors import InputError, OutputError, written_as
from warpgrains.base.files import require_writable_path, write_atomically
from warpgrains.scene.fields import FIELDS, SECTIONS
from warpgrains.scene.layouts import COMMON, LAYOUTS
from warpgrains.scene.reader import (
    DOMAINS,
    PROPERTIES,
    SOURCES,
    domain_keys,
    keyword_parameters,
    section_fields,
)
from warpgrains.scene.sources import Sink, Source
from warpgrains.scene.toml import Table, parse_toml, read_text, shipped, toml_value
from warpgrains.walls.box import Box
from warpgrains.walls.kinds import WRITTEN_KINDS

KINDS = {"scene": "warpgrains run NAME", "sweep": "warpgrains batch NAME -o DIR"}
_LISTS = {
    "walls": "a wall inside the domain",
    "sources": "a region in which grains appear",
    "sinks": "a region from which grains are taken",
}
NARROWEST, WIDTH = 90, 110


def scenes(arguments: Namespace) -> bool:
    """List the shipped scenes and sweeps, or show one scene with all keys of scene files."""
    print(_lists() if arguments.scene is None else _explained(arguments.scene))
    return False


def init(arguments: Namespace) -> bool:
    """Write a new scene file in which every key is explained."""
    path = Path(arguments.file)
    if path.exists():
        raise OutputError(f"refusing to overwrite '{path}': choose another name, or delete it")
    require_writable_path("scene", path, ".toml")
    text = f"# A scene to start from, made from {arguments.base}. Try: warpgrains run {path}\n"
    write_atomically(path, (text + commented(_read(arguments.base)[1])).encode())
    print(path)
    return False


def _lists() -> str:
    parts = []
    for kind, command in KINDS.items():
        firsts = {name: read_text(Path(name), kind).partition("\n")[0] for name in shipped(kind)}
        names = {name: first.lstrip("# ") for name, first in firsts.items()}
        parts.append(f"{kind}s ({command})\n{in_columns(names)}")
    return "\n\n".join(parts) + "\n\nwarpgrains scenes NAME shows a scene and every key it could have."


def _read(name: str) -> tuple[str, Table]:
    """Return text and sections of a scene file; InputError for an unknown section, key or layout."""
    text = read_text(Path(name), "scene")
    document = parse_toml(text, name)
    with written_as({}, name):
        section_fields(document)
        if "layout" in (grains := document.get("grains", {})):
            checks.one_of("grains.layout", grains["layout"], LAYOUTS)
    return text, document


def _explained(name: str) -> str:
    """Return the text of a scene's file and a table of all keys."""
    text, document = _read(name)
    width = max(NARROWEST, min(WIDTH, shutil.get_terminal_size((WIDTH, 0)).columns))
    found = [*keys(document.get("grains", {}).get("layout")), *wall_keys(), *exchange_keys()]
    rows = [
        ("key", "unit", "default"),
        *((f"{key.section}.{key.name}", key.unit, key.shown_default) for key in found),
    ]
    longest = [max(map(len, column)) + 1 for column in zip(*rows, strict=True)]
    heads = ["".join(f"{cell:<{own}}" for cell, own in zip(row, longest, strict=True)) for row in rows]
    lines, indent = [text.rstrip(), "", f"{heads[0]}meaning"], " " * len(heads[0])
    for key, head in zip(found, heads[1:], strict=True):
        lines += textwrap.wrap(key.meaning, width, initial_indent=head, subsequent_indent=indent)
    return "\n".join(lines)


class Key(NamedTuple):
    section: str
    name: str
    default: Any
    """Default value, or None."""
    meaning: str
    mark: str = "absent"
    """Text in place of a missing default: "required", "inherited" (from a key named in the meaning) or
    "absent"."""

    @classmethod
    def of(cls, section: str, name: str, field: Field[Any]) -> Self:
        meaning, mark = field.metadata["meaning"], field.metadata.get("mark", "absent")
        if field.default is MISSING:
            return cls(section, name, None, meaning, "required")
        return cls(section, name, None if field.default == "" else field.default, meaning, mark)

    @property
    def unit(self) -> str:
        found = re.search(r"(?<!`)\[([^\]]+)\]", self.meaning)
        return found[1] if found else ""

    @property
    def shown_default(self) -> str:
        return self.mark if self.default is None else toml_value(self.default)


def keys(layout: str | None, domains: Iterable[str] = DOMAINS) -> Iterator[Key]:
    """Yield all keys of scene files in order, for the given kinds of domains.

    The keys of [grains] are those of `layout`, or of listed grains if it is None.
    """
    of_boxes = described_fields(Box)
    kind = Key("domain", "kind", "annulus", f"Kind of the domain, {' or '.join(map(toml_value, DOMAINS))}.")
    for section, names in SECTIONS.items():
        for name in domain_keys(domains) if section == "domain" else names:
            field = FIELDS.get(name) or of_boxes.get(name)
            yield Key.of(section, name, field) if field else kind
    yield from (Key("grains", name, None, meaning, "required") for name, meaning in SOURCES.items())
    if layout in LAYOUTS:
        own = {**COMMON, **parameters_of(LAYOUTS[layout])}
        for name, parameter in keyword_parameters(LAYOUTS[layout]).items():
            if name not in own:
                raise InputError(f"layout {layout!r} has the parameter {name}: describe it in its docstring")
            if parameter.default is parameter.empty:
                yield Key("grains", name, None, own[name], "required")
            else:
                yield Key("grains", name, parameter.default, own[name])
    else:
        yield Key("grains", "radius", None, COMMON["radius"], "required")
    for name, meaning in PROPERTIES.items():
        yield Key("grains", name, None, meaning, "required" if name in ("mass", "density") else "absent")


def wall_keys() -> Iterator[Key]:
    """Yield the keys of `[[walls]]`: first those of single kinds of walls, then those of all kinds."""
    kinds = f"Kind of a wall inside the domain: {', '.join(WRITTEN_KINDS)}."
    yield Key("walls", "kind", None, kinds, "required")
    found = {name: field for wall in WRITTEN_KINDS.values() for name, field in wall.keys().items()}
    for name, field in sorted(found.items(), key=lambda item: item[1].kw_only is True):
        with_key = [kind for kind, wall in WRITTEN_KINDS.items() if name in wall.keys()]  # noqa: SIM118
        key = Key.of("walls", name, field)
        yield key if field.kw_only else key._replace(meaning=f"{', '.join(with_key)}: {key.meaning}")


def exchange_keys() -> Iterator[Key]:
    """Yield the keys of `[[sources]]`, then those of `[[sinks]]`."""
    for section, kind in {"sources": Source, "sinks": Sink}.items():
        for name, own in described_fields(kind).items():
            yield Key.of(section, name, own)


def commented(document: Table) -> str:
    """Return a scene as TOML with every key explained; missing keys are commented out."""
    lines, section = [], ""
    domain = document.get("domain", {}).get("kind", "annulus")
    for key in keys(document.get("grains", {}).get("layout"), [domain]):
        if key.section != section:
            section = key.section
            lines.append(f"\n[{section}]")
        lines += textwrap.wrap(key.meaning, 98, initial_indent="# ", subsequent_indent="# ")
        if key.name in document.get(section, {}):
            lines.append(f"{key.name} = {toml_value(document[section][key.name])}")
        else:
            value = "..." if key.default is None else key.shown_default
            lines.append(f"# {key.name} = {value}")
    for section, meaning in _LISTS.items():
        lines.append(f"\n# A table [[{section}]] is {meaning}.")
        for key in (*wall_keys(), *exchange_keys()):
            if key.section == section:
                text = f"{key.name}: {key.meaning}"
                lines += textwrap.wrap(text, 98, initial_indent="# ", subsequent_indent="#     ")
        for table in document.get(section, []):
            lines.append(f"\n[[{section}]]")
            lines += [f"{name} = {toml_value(value)}" for name, value in table.items()]
    return "\n".join(lines) + "\n"


def parameters_of(documented: Callable[..., Any]) -> dict[str, str]:
    """Return the descriptions of the parameters in a numpy-style docstring, on one line each."""
    text = inspect.getdoc(documented) or ""
    found: dict[str, str] = {}
    names: list[str] = []
    body = re.split(r"^Parameters\n-+\n", text, flags=re.M)[1:]
    for line in body[0].splitlines() if body else []:
        if not line.strip():
            break
        if line.startswith(" "):
            found |= {name: f"{found[name]} {line.strip()}".strip() for name in names}
        else:
            names = [name.strip() for name in line.partition(":")[0].split(",")]
            found |= dict.fromkeys(names, "")
    return found
