"""The files that a C compiler needs."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_PROGRAMS = ("cc", "as", "ld")
_OTHERS = ("/etc/ld.so.cache", "/dev/null")
_INCLUDE = re.compile(r"search starts here:\n(.*?)End of search list", re.DOTALL)


def toolchain_paths() -> list[Path]:
    """Return where the programs, libraries and headers of the compiler `cc` are, without this package."""
    found = {Path(path) for path in _OTHERS}
    found |= {Path(path) for name in _PROGRAMS if (path := shutil.which(name))}
    for line in _lines_of("cc", "-print-search-dirs").splitlines():
        found |= {Path(path) for path in line.partition("=")[2].split(os.pathsep) if path.startswith("/")}
    for folders in _INCLUDE.findall(_lines_of("cc", "-E", "-v", "-x", "c", os.devnull)):
        found |= {Path(line.strip()) for line in folders.splitlines() if line.startswith(" /")}
    resolved = {path.resolve() for path in found if path.exists()}
    outermost = {path for path in resolved if not resolved & set(path.parents)}
    return sorted(each for path in outermost for each in _without_package(path))


def _without_package(path: Path) -> Iterator[Path]:
    """Yield a path, or what is in it beside this package."""
    if path not in (_PACKAGE, *_PACKAGE.parents):
        yield path
    elif path != _PACKAGE:
        for inside in path.iterdir():
            if not inside.is_symlink():
                yield from _without_package(inside)


def _lines_of(*command: str) -> str:
    """Return what a command prints."""
    done = subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "LC_ALL": "C"},
        text=True,
        errors="replace",
        check=False,
    )
    return done.stdout
