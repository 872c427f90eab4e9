"""Sweep files: TOML text in, the runs of a sweep out.

======== =================== ======================================================================
section  keys                meaning
======== =================== ======================================================================
(top)    scene               the base scene: a file next to the sweep file, or a shipped scene
..       or: folder          a folder next to the sweep file: each of its .toml files is a base scene
..       combine             "grid" (default): all combinations of the values of the axes;
                             "zip": the first values of all axes, then the second ones, ...
set      section.key         a value that replaces the base scene's in all runs
axes     section.key         a list of values, one of which each run has, see `axes`
..       or: a name, NAME    values that are inserted for "$NAME", "-$NAME", "0.5 $NAME" in [set]
======== =================== ======================================================================

The keys are those of scene files: ``physics.drag = [0.1, 0.5]`` in ``[axes]`` is an axis of two values. The
keys of the first of ``[[walls]]`` are ``walls.0.friction`` and so on, those of the upper side of a box
``domain.top.pressure`` and so on.
"""

import hashlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import prod
from operator import eq
from pathlib import Path
from typing import Any, NamedTuple, Self

from warpgrains.analysis.quantity_table import QUANTITIES
from warpgrains.base import checks
from warpgrains.base.errors import InputError, written_as
from warpgrains.base.files import Row, read_regular
from warpgrains.scene.fields import KEY_OF
from warpgrains.scene.reader import is_file_of_radii, read_radii, require_key
from warpgrains.scene.toml import (
    Table,
    parse_toml,
    read_text,
    shipped,
    shipped_scenes,
    shipped_text,
    toml_text,
    toml_value,
    with_key,
)
from warpgrains.sweep.axes import KINDS as AXIS_KINDS
from warpgrains.sweep.axes import MOST_VALUES, axis_values
from warpgrains.sweep.results import COLUMNS
from warpgrains.walls.box import SIDES

KEYS = ("scene", "folder", "combine", "set", "axes")
COMBINATIONS = ("grid", "zip")
GRAINS = "grains"  # folder for copies of files of grains, in the folder of the sweep

_INSERTED = re.compile(r"(-?(?:\d+(?:\.\d+)? *)?)\$(\w+)")  # a factor, and the name of an axis

KeyValues = dict[str, Any]
"""Values by key, such as "physics.drag"."""


class GrainFile(NamedTuple):
    """A file of grains. The folder of the sweep holds a copy of the file, which the runs read."""

    source: Path
    copy: str
    """Name of the copy, which contains a hash of the content."""


@dataclass(frozen=True, eq=False)
class BaseScene:
    """A scene from which runs are derived, by setting the values on the axes."""

    name: str
    sections: Table
    """Sections of the scene file, with the values that the sweep sets for all runs."""
    grain_files: dict[str, GrainFile]
    """Files of grains, by their names in the sweep file or in the scene file."""
    formulas: KeyValues
    """Values of [set] that contain the name of an axis, such as "0.5 $NAME", by key."""

    @property
    def text(self) -> str:
        """Text of a scene file with the common part of the runs.

        Paths of files of grains are relative to the folder of this scene file.
        """
        copies = {name: f"../{GRAINS}/{file.copy}" for name, file in self.grain_files.items()}
        notes = [f"# {toml_value(name)} is {toml_value(copy)}\n" for name, copy in copies.items()]
        return "".join(notes) + toml_text(self.with_values({}, f"../{GRAINS}"))

    def with_values(self, values: KeyValues, copies: str) -> Table:
        """Return the sections of the scene file after setting `values`, which are given by key.

        The name of a file of grains is replaced by that of its copy in folder `copies`.
        """
        sections = _with_values(self.sections, values)
        grains = self.grain_files.get(sections.get("grains", {}).get("file"))
        if grains is not None:
            sections["grains"]["file"] = f"{copies}/{grains.copy}"
        return sections


@dataclass(frozen=True, eq=False)
class Run:
    number: int
    """Index of the run in the sweep, from 0."""
    base: BaseScene
    values: KeyValues
    """Values on the axes, by key."""

    def labels(self) -> Row:
        """Return the cells of the columns that identify the run, by column: number, scene and values."""
        values = self.values.items()
        cells = {key: value if isinstance(value, str) else toml_value(value) for key, value in values}
        return {"run": str(self.number), "scene": self.base.name, **cells}

    def changes(self) -> KeyValues:
        """Return the values that the run sets in its base scene, by key: on its axes, and from formulas."""
        inserted = {key: _inserted(value, self.values) for key, value in self.base.formulas.items()}
        return {key: value for key, value in self.values.items() if "." in key} | inserted

    def sections(self, copies: str) -> Table:
        """Return the sections of the run's scene file, which names copies of files in folder `copies`."""
        return self.base.with_values(self.changes(), copies)

    def text(self, copies: str) -> str:
        """Return the text of the run's scene file, where copies of files of grains are in folder `copies`."""
        values = ", ".join(f"{key} = {toml_value(value)}" for key, value in self.values.items())
        name = self.base.name if self.base.name.isprintable() else toml_value(self.base.name)
        head = f"# run {self.number} of a sweep over {name}{values and ': '}{values}\n\n"
        return head + toml_text(self.sections(copies))


@dataclass(frozen=True, eq=False)
class Sweep:
    """All runs of a sweep."""

    runs: list[Run]
    """Runs in the order of the axes, the last axis varying fastest."""
    axes: tuple[str, ...]
    """Keys of the axes."""
    bases: list[BaseScene]
    plan: Table
    """Names of the scenes, values of the axes, and how they are combined, see `have_same_runs`."""

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read a sweep file, a folder of scenes, or a shipped sweep; InputError names key and value."""
        path = Path(path)
        is_folder = os.path.isdir(path)
        if str(path) in shipped("sweep") and not any(path.glob("*.toml")):
            is_folder = False  # results of the shipped sweep may be in a folder of its name
        document: Table = {"folder": "."} if is_folder else parse_toml(read_text(path, "sweep"), path)
        with written_as({}, str(path)):
            return cls._of(document, path if is_folder else path.parent)

    @classmethod
    def _of(cls, document: Table, folder: Path) -> Self:
        """Return the sweep that `document` describes; names of files in it are relative to `folder`."""
        for key in document:
            checks.one_of("key of a sweep", key, KEYS)
        combine = checks.one_of("combine", document.get("combine", "grid"), COMBINATIONS)
        if document.get("axes") == {}:
            raise InputError(
                "axes is empty: give an axis such as physics.drag = [0.1, 0.2], or remove [axes]"
            )
        fixed, axes = _by_key(document, "set"), _by_key(document, "axes")
        for key in fixed.keys() & axes.keys():
            raise InputError(f"{key} is in [set] and in [axes]: it must be in one of them")
        lists = {key: axis_values(key, axis) for key, axis in axes.items()}
        _require_uses(fixed, [key for key in lists if "." not in key])
        for value in lists.get("grains.radius", []):
            if is_file_of_radii(value):
                raise InputError(f"grains.radius of an axis is {value!r}: files of radii belong into scenes")
        for key, values in ({key: [value] for key, value in fixed.items()} | lists).items():
            for value in values:
                _require_toml(key, value)
        bases = list(_bases(document, folder, fixed, lists))
        count = len(bases) * prod(map(len, lists.values()))
        if combine == "grid" and count > MOST_VALUES:
            raise InputError(
                f"scenes and axes have {count} combinations: a sweep has at most {MOST_VALUES} runs"
            )
        pairs = product(bases, _combinations(lists, combine))
        plan = {"scenes": [base.name for base in bases], "axes": lists, "combine": combine}
        return cls([Run(number, *pair) for number, pair in enumerate(pairs)], tuple(lists), bases, plan)


def have_same_runs(plan: Table, other: Table) -> bool:
    """Return whether two plans, see `Sweep.plan`, begin with the same runs.

    All runs of the sweep with fewer runs are then runs of the other one, with the same numbers.
    """
    if plan == other or list(plan["axes"]) != list(other["axes"]):
        return bool(plan == other)
    runs = (product(one["scenes"], _combinations(one["axes"], one["combine"])) for one in (plan, other))
    return all(map(eq, *runs))


def _by_key(document: Table, name: str) -> KeyValues:
    """Return the entries of section `name`, [set] or [axes], by key such as "physics.drag".

    The key of an axis with a name is that name. InputError for keys that scene files do not have.
    """
    found: KeyValues = {}
    for section, table in _table(name, document.get(name, {})).items():
        if "." in section:
            raise InputError(
                f"{name} has the key {section!r} in quotes: write it without them, {name}.{section}"
            )
        if name == "axes" and _is_named(section, table):
            found[section] = table
            continue
        for key, value in _table(f"{name}.{section}", table).items():
            is_table = section == "walls" or (section == "domain" and key in SIDES)
            for full, each in _leaves(key, value) if is_table else [(key, value)]:
                with written_as({}, f"{name}.{section}.{full}"):
                    require_key(section, full)
                found[f"{section}.{full}"] = each
    return found


def _leaves(key: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield keys and values in nested tables below `key`. A table that describes an axis is one value."""
    if not isinstance(value, dict) or not value.keys().isdisjoint(AXIS_KINDS):
        yield key, value
        return
    for name, own in value.items():
        yield from _leaves(f"{key}.{name}", own)


def _is_named(name: str, axis: Any) -> bool:
    """Return whether the entry `name` of [axes] is an axis with this name, not a section of keys.

    InputError if results have a column of this name.
    """
    is_axis = isinstance(axis, list) or (isinstance(axis, dict) and not axis.keys().isdisjoint(AXIS_KINDS))
    if not (is_axis and re.fullmatch(r"\w+", name)):
        return False
    if name in ("run", "scene", *COLUMNS, *QUANTITIES):
        raise InputError(f"axes.{name}: results have a column of this name; choose another one")
    return True


def _require_uses(fixed: KeyValues, named: list[str]) -> None:
    """Raise InputError unless the values of [set] use the name of every named axis, and no other name."""
    used = {name: key for key, value in fixed.items() for name in _names_in(value)}
    for name in used.keys() - named:
        raise InputError(f"{used[name]} in [set] is {fixed[used[name]]!r}: [axes] has no {name}")
    for name in named:
        if name not in used:
            told = f", or did you mean axes.{KEY_OF[name]}?" if name in KEY_OF else ""
            uses = f"'${name}', '-${name}' or '0.5 ${name}'"
            raise InputError(f"axes.{name}: no value in [set] is {uses}{told}")


def _names_in(value: Any) -> set[str]:
    """Return the names of axes, such as NAME in "0.5 $NAME", that a value uses."""
    if isinstance(value, str):
        return {found[2]} if (found := _INSERTED.fullmatch(value)) else set()
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return set().union(*map(_names_in, parts))


def _inserted(value: Any, values: KeyValues) -> Any:
    """Return a value of [set] in which values of the axes replace texts like "$NAME" or "0.5 $NAME"."""
    match value:
        case str() if found := _INSERTED.fullmatch(value):
            factor, name = found.groups()
            if not factor:
                return values[name]
            own = checks.number(f"axes.{name}", values[name])
            return own * float(factor.replace(" ", "") if factor.strip(" -") else factor + "1")
        case dict():
            return {key: _inserted(own, values) for key, own in value.items()}
        case list():
            return [_inserted(own, values) for own in value]
    return value


def _require_toml(key: str, value: Any) -> None:
    """Raise InputError if a scene file cannot hold a value, such as a date."""
    try:
        toml_value(value)
    except InputError as error:
        raise InputError(f"{key}: {error}") from None


def _table(name: str, value: Any) -> Table:
    if not isinstance(value, dict):
        raise InputError(f"{name} is {value!r}: it must be a section")
    return value


def _combinations(lists: dict[str, list[Any]], combine: str) -> list[KeyValues]:
    lengths = {key: len(values) for key, values in lists.items()}
    if combine == "zip" and len(set(lengths.values())) > 1:
        counts = ", ".join(f"{key} {length}" for key, length in lengths.items())
        raise InputError(f"combine is 'zip': all axes must have the same number of values, not {counts}")
    together = zip(*lists.values(), strict=True) if combine == "zip" and lists else None
    return [dict(zip(lists, row, strict=True)) for row in together or product(*lists.values())]


def _bases(
    document: Table, folder: Path, fixed: KeyValues, lists: dict[str, list[Any]]
) -> Iterator[BaseScene]:
    for name, base, where in _base_documents(document, folder):
        sections = _with_values(base, fixed)
        for key in ("sources", "sinks"):
            if sections.get(key):
                raise InputError(f"scene {name!r} has [[{key}]], which no sweep takes: `warpgrains run` does")
        toml_value(name)  # a cell of the tables: it must be text
        grains = _table("grains", sections.get("grains", {}))
        if is_file_of_radii(grains.get("radius")):
            radii = read_radii(where, grains["radius"]).tolist()
            if len(radii) == 2:
                raise InputError(
                    f"grains.radius: file {grains['radius']['file']!r} has two radii, which runs of a sweep"
                    " cannot list: in their scene files, two numbers are the bounds of a distribution"
                )
            grains["radius"] = radii
        file = grains.get("file")
        files = lists.get("grains.file", [] if file is None else [file])
        formulas = {key: value for key, value in fixed.items() if _names_in(value)}
        yield BaseScene(name, sections, {file: _grain_file(where, file) for file in files}, formulas)


def _base_documents(document: Table, folder: Path) -> Iterator[tuple[str, Table, Path]]:
    """Yield the name and the sections of each base scene, and the folder of the files that it names."""
    given = checks.only_one("a sweep", document, ("scene", "folder"))
    name = document[given]
    if not isinstance(name, str):
        raise InputError(f"{given} is {name!r}: it must be the name of a {given}")
    if given == "scene" and name in shipped_scenes() and not (folder / name).is_file():
        yield name, parse_toml(shipped_text("scene", name), name), folder
        return
    paths = [folder / name] if given == "scene" else sorted((folder / name).glob("*.toml"))
    if not paths:
        found = "has no scenes" if (folder / name).is_dir() else "does not exist"
        raise InputError(f"folder {str(folder / name)!r} {found}: it must hold .toml files")
    for path in paths:
        yield path.stem, parse_toml(read_text(path, "scene"), path), path.parent


def _grain_file(folder: Path, name: Any) -> GrainFile:
    if not isinstance(name, str) or "\0" in name or not (folder / name).is_file():
        raise InputError(f"grains.file is {name!r}: it does not exist in {str(folder)!r}")
    if not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise InputError(
            f"grains.file is {name!r}: it must be in the folder of its scene, because results contain a copy"
        )
    source = folder / name
    return GrainFile(source, f"{hashlib.sha256(read_regular(source)).hexdigest()[:12]}-{source.name}")


def _with_values(sections: Table, values: KeyValues) -> Table:
    changed = {name: dict(table) if isinstance(table, dict) else table for name, table in sections.items()}
    for key, value in values.items():
        changed = with_key(changed, key, value)
    return changed
