"""Checkpoints: the exact state and its scene in one `.npz` file without pickles.

The entry `header` is JSON text in UTF-8 with the format, the version, and all numbers and texts. Floats are
written so that the same doubles are read back. Every array is a separate entry `part.field`, named after the
dataclasses `Scene`, `State`, `Corrections` and `VerletList` (part `lists`); the parts
`last_scene` and `start` are a `Scene`, too.

If a field of these, of `RunOptions` or of `Summary` is added, removed, renamed or changes its meaning,
`VERSION` must increase, so that other versions of the program report that they cannot read the file. A new
field of `Scene` is an exception: earlier files get its default, and earlier programs report it as unknown.
"""

import io
import json
import zipfile
from dataclasses import asdict, dataclass, fields, replace
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from warpgrains import __version__
from warpgrains.base import checks
from warpgrains.base.errors import InputError
from warpgrains.base.files import require_writable_path, resolve_link, write_atomically
from warpgrains.base.locks import Lock, lock_own
from warpgrains.scene.fields import SceneFields
from warpgrains.scene.scene import Scene
from warpgrains.scene.state import Corrections, State, VerletList, require_state
from warpgrains.simulation.options import RunOptions
from warpgrains.solver.statistics import Summary

FORMAT = "warpgrains checkpoint"
VERSION = 19
MOST_COUNTED = 2**63 - 1

Arrays = dict[str, np.ndarray]
Header = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Checkpoint:
    scene: Scene
    state: State
    options: RunOptions | None
    """Options of the run that wrote the checkpoint, if a run wrote it."""
    statistics: Summary
    """Statistics of the run up to the checkpoint."""
    start: Scene | None = None
    """Scene at the start of the run, for which outputs were opened; None if it is `scene`."""

    @property
    def first_step(self) -> int:
        return self.state.steps - self.statistics.steps


def lock_checkpoint(path: Path) -> Lock:
    """Lock a checkpoint for writing; InputError if `path` cannot be written or is another file."""
    require_writable_path("checkpoint", path, ".npz")
    return lock_own(path, _is_checkpoint, "checkpoint")


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Write a locked checkpoint atomically. The old file stays until the new file is on the disk."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **_entries(checkpoint, path))
    write_atomically(path, buffer.getbuffer())


def read_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint of this version; InputError if it is missing, damaged, or another file."""
    path, told = resolve_link(path), "`warpgrains run SCENE --checkpoint FILE` writes one"
    if not path.is_file():
        raise InputError(f"checkpoint '{path}' does not exist: {told}")
    try:
        header, arrays = _read(path)
    except Exception:  # readers of damaged files raise errors of any kind
        raise InputError(f"'{path}' is not a checkpoint of warpgrains, or it is damaged: {told}") from None
    if header["version"] != VERSION:
        raise InputError(
            f"checkpoint '{path}' has version {header['version']}, of warpgrains {header.get('warpgrains')};"
            f" warpgrains {__version__} reads version {VERSION}"
        )
    try:
        return _checkpoint(header, arrays, path)
    except Exception as error:
        raise InputError(f"checkpoint '{path}' holds an invalid state: {error}") from None


def _entries(checkpoint: Checkpoint, path: Path) -> Arrays:
    options = checkpoint.options
    header: Header = {
        "format": FORMAT,
        "version": VERSION,
        "warpgrains": __version__,
        "options": None if options is None else options.stored(path),
        "statistics": asdict(replace(checkpoint.statistics, error=None)),  # a resumed run starts without
    }
    arrays: Arrays = {}
    for part, record in _parts(checkpoint).items():
        content = {field.name: getattr(record, field.name) for field in fields(record)}
        if isinstance(record, Scene):
            content["walls"] = record.written_walls
        own = [name for name, value in content.items() if isinstance(value, np.ndarray)]
        arrays |= {f"{part}.{name}": content[name] for name in own}
        elsewhere = (*own, "corrections", "lists", "last_scene")
        header[part] = {name: value for name, value in content.items() if name not in elsewhere}
    # walls, and gravity that turns, are stored as their tables in a scene file
    text = json.dumps(header, default=attrgetter("table"))
    return {"header": np.frombuffer(text.encode(), np.uint8), **arrays}


def _parts(checkpoint: Checkpoint) -> dict[str, Any]:
    parts = {name: getattr(checkpoint, name) for name in ("scene", "state", "start")}
    parts |= {name: getattr(checkpoint.state, name) for name in ("corrections", "lists", "last_scene")}
    return {part: record for part, record in parts.items() if record is not None}


def _read(path: Path) -> tuple[Header, Arrays]:
    """Return header and arrays without checking their content."""
    with zipfile.ZipFile(path) as archive:
        # without compressed entries, a small file cannot expand to fill the memory
        if any(entry.compress_type != zipfile.ZIP_STORED for entry in archive.infolist()):
            raise ValueError("an entry is compressed")
        if archive.testzip() is not None:
            raise ValueError("an entry is damaged")
    with np.load(path, allow_pickle=False) as entries:
        arrays = {name: entries[name] for name in entries.files}
    return _header(arrays.pop("header")), arrays


def _header(entry: np.ndarray) -> Header:
    header = json.loads(entry.tobytes())
    if header["format"] != FORMAT or type(header["version"]) is not int:
        raise ValueError("the header is that of something else")
    return header


def _is_checkpoint(path: Path) -> bool:
    try:
        with np.load(path, allow_pickle=False) as entries:
            return bool(_header(entries["header"]))
    except Exception:
        return False


def _checkpoint(header: Header, arrays: Arrays, path: Path) -> Checkpoint:
    """Return the checkpoint that header and arrays describe, after checking them."""

    def part(name: str) -> dict[str, Any]:
        prefix = f"{name}."
        own = {entry.removeprefix(prefix): arrays[entry] for entry in arrays if entry.startswith(prefix)}
        return header[name] | own

    def scene_of(name: str) -> Scene:
        return Scene.made(vars(SceneFields(**part(name))))

    scene = scene_of("scene")
    lists = VerletList(**part("lists")) if "lists" in header else None
    last, start = (scene_of(name) if name in header else None for name in ("last_scene", "start"))
    corrections = Corrections(**part("corrections"))
    state = State(corrections=corrections, lists=lists, last_scene=last, **part("state"))
    require_state(state, scene)
    options = None if header["options"] is None else RunOptions.restored(header["options"], path)
    statistics = Summary(**header["statistics"])
    _require_statistics(statistics, state, options)
    return Checkpoint(scene, state, options, statistics, start)


def _require_statistics(statistics: Summary, state: State, options: RunOptions | None) -> None:
    """Raise InputError unless a run of these options, now at this state, can have these statistics."""
    for field in fields(Summary):
        value = getattr(statistics, field.name)
        if isinstance(field.default, bool):
            checks.boolean(field.name, value)
        elif isinstance(field.default, int):
            most = state.steps if field.name == "steps" else MOST_COUNTED
            checks.whole_number(field.name, value, least=0, most=most)
        elif isinstance(field.default, float) and not (isinstance(value, float | int) and value >= 0.0):
            raise InputError(f"{field.name} is {value!r}: it must be a number, 0 or more")
        elif field.default is None and value is not None:
            raise InputError(f"{field.name} is {value!r}: a checkpoint has none")
    if not all(isinstance(mean, float | int) for mean in statistics.means):
        raise InputError(f"means is {statistics.means!r}: it must hold numbers")
    if options is not None:
        checks.whole_number("steps", statistics.steps, least=0, most=options.steps)
        recorded = options.record is not None
        checks.whole_number("frames", statistics.frames, least=int(recorded), most=statistics.steps + 1)
