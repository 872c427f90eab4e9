"""`warpgrains scenes` and `warpgrains init`: what scenes there are, what is in them, and how to begin one."""

import shutil
import textwrap
from argparse import Namespace
from pathlib import Path

from warpgrains.console import in_columns
from warpgrains.errors import OutputError
from warpgrains.files import require_place, write_whole
from warpgrains.scene.document import parse_toml, read_document, read_text, shipped
from warpgrains.scene.keys import commented, keys

KINDS = {"scene": "warpgrains run NAME", "sweep": "warpgrains batch NAME -o DIR"}
NARROWEST, WIDTH = 90, 110


def scenes(arguments: Namespace) -> bool:
    """List the shipped scenes and sweeps, or show one scene and every key that it could have."""
    print(_lists() if arguments.scene is None else _explained(arguments.scene))
    return False


def init(arguments: Namespace) -> bool:
    """Write a scene file to begin with, every key of it explained."""
    path = Path(arguments.file)
    if path.exists():
        raise OutputError(f"'{path}' is there: it is not replaced")
    require_place("scene", path, ".toml")
    text = f"# A scene to begin with, made from {arguments.base}. Try: warpgrains run {path}\n"
    write_whole(path, (text + commented(read_document(arguments.base))).encode())
    print(path)
    return False


def _lists() -> str:
    parts = []
    for kind, command in KINDS.items():
        names = {name: _first_remark(read_text(Path(name), kind)) for name in shipped(kind)}
        parts.append(f"{kind}s ({command})\n{in_columns(names)}")
    return "\n\n".join(parts) + "\n\nwarpgrains scenes NAME shows a scene and every key it could have."


def _first_remark(text: str) -> str:
    return text.partition("\n")[0].lstrip("# ")


def _explained(name: str) -> str:
    """Return a scene's file, and a table of all keys."""
    text = read_text(Path(name), "scene")
    document = parse_toml(text, name)
    width = max(NARROWEST, min(WIDTH, shutil.get_terminal_size((WIDTH, 0)).columns))
    lines = [text.rstrip(), "", f"{'key':<24}{'unit':<12}{'default':<22}meaning"]
    for key in keys(document.get("grains", {}).get("layout")):
        head = f"{key.section}.{key.name:<{23 - len(key.section)}}{key.unit:<12}{key.shown_default:<22}"
        lines += textwrap.wrap(key.meaning, width, initial_indent=head, subsequent_indent=" " * 58)
    return "\n".join(lines)
