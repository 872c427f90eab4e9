"""What is compiled: the child, the reference, wrong versions of it, and homeworks."""

import os
import re
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

from warpgrains.errors import SceneError
from warpgrains.reference.reference import SOURCE

HOMEWORK = "homework.c"
UPDATE, CONTACT = "femGrainsUpdate", "femGrainsContactIterate"
WITHOUT = {UPDATE: "-DNOUPDATE", CONTACT: "-DNOCONTACTITERATE"}
"""The two functions, and the course's marker that leaves each of them out."""

SECONDS, KILOBYTES = 30, 4 * 2**20
"""Limits of the compiler: a homework can make it work without end."""

_FLAGS = ("-O2", "-Wall", "-ffp-contract=off")
_STRICT = ("-Werror=implicit-function-declaration", "-Werror=incompatible-pointer-types")
_HEADERS = SOURCE.parent
_PARTS = [Path(__file__).parent / name for name in ("child.c", "confine.c", "guarded.c")]
_INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([\w.-]+)"', re.MULTILINE)
_LONGEST = 2**20  # bytes of a homework, and of what the compiler says of it


class CompileError(Exception):
    """The compiler refused: its own lines."""


def read_homework(source: Path) -> bytes:
    """Return the text of a homework; raise SceneError if it cannot be read."""
    try:
        with source.open("rb") as file:
            text = file.read(_LONGEST + 1)
    except OSError as error:
        raise SceneError(f"'{source}' cannot be read: {error.strerror}") from None
    if len(text) > _LONGEST:
        raise SceneError(f"'{source}' is no homework: it has more than {_LONGEST} bytes")
    return text


def compile_homework(text: bytes, folder: Path, defines: Sequence[str] = ()) -> tuple[Path, str]:
    """Compile a homework to a library in a folder, and return it with the compiler's warnings.

    Whatever header it includes by a plain name is the course's.

    Raises
    ------
    CompileError
        It does not compile.
    SceneError
        There is no C compiler.
    """
    folder.mkdir(exist_ok=True)
    for name in {"fem.h", *(found.decode() for found in _INCLUDE.findall(text))}:
        (folder / name).write_bytes((_HEADERS / "fem.h").read_bytes())
    (folder / HOMEWORK).write_bytes(text)
    return compile_library(HOMEWORK, folder, defines)


def compile_library(source: str, folder: Path, defines: Sequence[str] = ()) -> tuple[Path, str]:
    """Compile a source in a folder to a library beside it; only the two functions can be replaced in it."""
    library, own = folder / f"{Path(source).stem}{''.join(defines)}.so", folder / "own.list"
    own.write_text(f"{{ {UPDATE}; {CONTACT}; }};\n")
    shared = ["-fPIC", "-shared", "-fsemantic-interposition", f"-Wl,--dynamic-list={own}"]
    command = [
        *_FLAGS,
        *_STRICT,
        *defines,
        *shared,
        "-I.",
        f"-I{_HEADERS}",
        source,
        "-o",
        str(library),
        "-lm",
    ]
    return library, _cc(command, folder)


def compile_child(folder: Path) -> Path:
    """Compile the program of the child process."""
    child = folder / "child"
    create = [*WITHOUT.values(), f"-I{_HEADERS}", "-rdynamic", *map(str, _PARTS), str(SOURCE)]
    _cc([*_FLAGS, *create, "-o", str(child), "-ldl", "-lm"], folder)
    return child


def _cc(arguments: Sequence[str], folder: Path) -> str:
    """Run the compiler within limits, and return what it says."""
    limits = f'ulimit -t {SECONDS}; ulimit -v {KILOBYTES}; ulimit -f {KILOBYTES // 16}; exec cc "$@"'
    try:
        process = subprocess.Popen(
            ["sh", "-c", limits, "cc", *arguments],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
    except FileNotFoundError as error:
        raise SceneError("homeworks are compiled by `sh` and `cc`: there is none of them") from error
    try:
        said, _ = process.communicate(timeout=2 * SECONDS)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise CompileError(f"the compiler does not end within {2 * SECONDS} s") from None
    lines = said[:_LONGEST].decode(errors="replace").strip()
    if process.returncode == 127:
        raise SceneError("a C compiler called `cc` is needed, and there is none")
    if process.returncode != 0:
        raise CompileError(lines or f"the compiler ended with code {process.returncode}")
    return lines
