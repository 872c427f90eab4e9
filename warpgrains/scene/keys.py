"""Every key of a scene file, as the docstrings of `Scene` and of the layouts tell of it."""

import inspect
import re
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import MISSING
from typing import Any, NamedTuple

from warpgrains.scene.document import Table
from warpgrains.scene.fields import FIELDS, SECTIONS
from warpgrains.scene.layouts import COMMON, LAYOUTS
from warpgrains.scene.reader import PROPERTIES, SOURCES, own_parameters
from warpgrains.scene.toml_text import toml_value

REQUIRED = object()
"""Default of a key that has none."""


class Key(NamedTuple):
    """A key of a scene file."""

    section: str
    name: str
    default: Any
    """None where there is no value for it: what it means tells what is so."""
    meaning: str

    @property
    def unit(self) -> str:
        """Its unit, if it has one."""
        found = re.search(r"\[([^\]]+)\]", self.meaning)
        return found[1] if found else ""

    @property
    def shown_default(self) -> str:
        """Its default as TOML."""
        if self.default is None:
            return "none"
        if self.default is REQUIRED:
            return "required"
        return toml_value(self.default)


def keys(layout: str | None) -> Iterator[Key]:
    """Yield all keys of a scene file in their order, for one layout, or for grains of other sources."""
    for section, names in SECTIONS.items():
        for name in names:
            field = FIELDS[name]
            default = REQUIRED if field.default is MISSING else field.default
            yield Key(section, name, default, field.metadata["meaning"])
    yield from (Key("grains", name, None, meaning) for name, meaning in SOURCES.items())
    if layout in LAYOUTS:
        own = {**COMMON, **parameters_of(LAYOUTS[layout])}
        for name, parameter in own_parameters(LAYOUTS[layout]).items():
            default = REQUIRED if parameter.default is parameter.empty else parameter.default
            yield Key("grains", name, default, own[name])
    else:
        yield Key("grains", "radius", None, COMMON["radius"])
    yield from (Key("grains", name, None, meaning) for name, meaning in PROPERTIES.items())


def commented(document: Table) -> str:
    """Return a scene as TOML with every key explained; those that it does not have are commented out."""
    lines, section = [], ""
    for key in keys(document.get("grains", {}).get("layout")):
        if key.section != section:
            section = key.section
            lines.append(f"\n[{section}]")
        lines += textwrap.wrap(key.meaning, 98, initial_indent="# ", subsequent_indent="# ")
        if key.name in document.get(section, {}):
            lines.append(f"{key.name} = {toml_value(document[section][key.name])}")
        else:
            value = "..." if key.default in (None, REQUIRED) else key.shown_default
            lines.append(f"# {key.name} = {value}")
    return "\n".join(lines) + "\n"


def parameters_of(documented: Callable[..., Any]) -> dict[str, str]:
    """Return what a docstring of the numpy convention says of each parameter, on one line each."""
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
