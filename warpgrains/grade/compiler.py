"""Compilation of the program of the sandbox, the reference, the model and homeworks."""

import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from math import inf
from pathlib import Path
from tempfile import TemporaryFile
from time import monotonic

from warpgrains.base.errors import InputError
from warpgrains.grade.sandbox import CONTACT, UPDATE, Processes
from warpgrains.reference.reference import DEFINES, SOURCE

HOMEWORK = "homework.c"
WITHOUT = {UPDATE: "-DNOUPDATE", CONTACT: "-DNOCONTACTITERATE"}
"""Compiler options by function: each defines the course's macro that excludes this function."""

SECONDS, MEMORY, OUTPUT = 30, 2**32, 2**27
"""Limits of the compiler, in s and bytes, because a homework can make it run for ever."""

_FLAGS = ("-O2", "-Wall", "-ffp-contract=off")
_FLAGS_OF_HOMEWORKS = ("-O0", *_FLAGS[1:])  # an optimizer sets to 0 what a homework does not set
_STRICT = ("-Werror=implicit-function-declaration", "-Werror=incompatible-pointer-types")
_REFERENCE = f"-I{SOURCE.parent}"
_HERE = Path(__file__).parent
_INCLUDE = re.compile(rb'^[ \t]*#[ \t]*include[ \t]*"([\w-][\w.-]{0,99}\.h)"', re.MULTILINE)
_PACKAGE = Path(__file__).resolve().parents[1]
_PROGRAMS = ("cc", "as", "ld")
_OTHERS = ("/etc/ld.so.cache", "/dev/null")
_SEARCHED = re.compile(r"search starts here:\n(.*?)End of search list", re.DOTALL)
LONGEST = 2**20  # bytes of a homework, and of the compiler's messages


class CompileError(Exception):
    """Failure of a compilation, with the compiler's messages."""


class Compiler:
    """The C compiler, with a folder for the files that all compilations need.

    Raises InputError if the compiler is missing or cannot compile them.
    """

    def __init__(self, folder: Path, processes: Processes):
        self._processes, self._fence = processes, folder / "fence"
        self._headers = folder / "headers"
        self._headers.mkdir()
        (self._headers / "fem.h").write_bytes((SOURCE.parent / "fem.h").read_bytes())
        self._compile(self._fence, str(_HERE / "fence.c"))
        self._readable = [str(path) for path in (self._headers, *toolchain_paths())]
        self.is_fenced = self._has_fence(folder / "trial")
        """Whether a homework can include only files of the compiler on this system."""

    def _has_fence(self, folder: Path) -> bool:
        """Return whether the kernel can restrict file access, and the compiler works with the restriction."""
        process = self._processes.start([str(self._fence)], cwd=folder.parent)
        try:
            if process.wait() != 0:
                return False
        finally:
            self._processes.end(process)
        try:
            self.compile_homework(b'#include "fem.h"\n', folder)
        except CompileError:
            self._readable = ["/"]
            return False
        return True

    def compile_child(self, folder: Path) -> Path:
        """Compile sandbox.c, the program that loads and calls a homework, in a folder; return its path."""
        create = [*WITHOUT.values(), "-rdynamic", str(_HERE / "sandbox.c"), str(SOURCE)]
        libraries = ["-Wl,--no-as-needed", "-ldl"]  # linked here because a homework cannot load more
        return self._compile(folder / "child", *create, *libraries)

    def compile_model(self, folder: Path) -> Path:
        """Compile the model of a homework (model.c) to a library in a folder; return its path.

        The folder must contain mistakes.h, the macros of all known mistakes.
        """
        model = [*_STRICT, "-fPIC", "-shared", f"-I{folder}", str(_HERE / "model.c")]
        return self._compile(folder / "model.so", *model)

    def compile_reference(self, folder: Path, defines: Sequence[str]) -> Path:
        """Compile the reference with macros `defines` to a library in a folder; return its path."""
        return self._compile(folder / f"{''.join(defines)}.so", *_options(folder, defines), str(SOURCE))

    def _compile(self, output: Path, *arguments: str) -> Path:
        """Compile a trusted source; return the path of the output. Raises InputError if that fails."""
        command = ["cc", *_FLAGS, *DEFINES, _REFERENCE, *arguments, "-o", str(output), "-lm"]
        try:
            self._run(command, output.parent)
        except CompileError as error:
            raise InputError(f"the C compiler failed: {error}") from None
        return output

    def compile_homework(
        self, text: bytes, folder: Path, defines: Sequence[str] = (), until: float = inf
    ) -> tuple[Path, str]:
        """Compile a homework; return the path of its library and the compiler's warnings.

        `defines` are further options, such as a value of `WITHOUT`. `until` is the time of `time.monotonic`
        at which the compiler is ended [s]. Raises CompileError.
        """
        aliases = folder / "headers"  # any header that it includes by a plain name is fem.h
        aliases.mkdir(parents=True, exist_ok=True)
        for found in set(_INCLUDE.findall(text)):
            (aliases / found.decode()).write_text("#include <fem.h>\n")
        (folder / HOMEWORK).write_bytes(text)
        library = folder / f"homework{''.join(defines)}.so"
        include = [f"-I{self._headers}", "-idirafter", str(aliases)]
        arguments = [
            *_FLAGS_OF_HOMEWORKS,
            *_options(folder, defines),
            *include,
            HOMEWORK,
            "-o",
            str(library),
            "-lm",
        ]
        limits = map(str, (SECONDS, MEMORY, OUTPUT))
        fence = [str(self._fence), *limits, str(folder), *self._readable, "--"]
        return library, self._run([*fence, "cc", *arguments], folder, until)

    def _run(self, command: Sequence[str], folder: Path, until: float = inf) -> str:
        """Run the compiler and return its messages. Raises CompileError if it fails or takes too long."""
        seconds = max(0.0, min(2.0 * SECONDS, until - monotonic()))
        with TemporaryFile() as output:
            try:
                process = self._processes.start(
                    command,
                    cwd=folder,
                    env={**os.environ, "TMPDIR": str(folder)},
                    stdout=output,
                    stderr=output,
                )
            except FileNotFoundError:
                raise InputError("no C compiler was found: install one as `cc`") from None
            try:
                code = process.wait(seconds)
            except subprocess.TimeoutExpired:
                raise CompileError(f"error: the compiler did not finish within {seconds:.0f} s") from None
            finally:
                self._processes.end(process)
            output.seek(0)
            lines = output.read(LONGEST).decode(errors="replace").strip()
        if code != 0:
            raise CompileError(lines or f"error: the compiler ended with code {code}")
        return lines


def _options(folder: Path, defines: Sequence[str]) -> list[str]:
    """Return compiler options for a library in which only calls of the two functions can be redirected.

    The program then takes each function from another library. `defines` are further options.
    """
    own = folder / "own.list"
    own.write_text(f"{{ {UPDATE}; {CONTACT}; }};\n")
    shared = ["-fPIC", "-shared", "-fsemantic-interposition", f"-Wl,--dynamic-list={own}"]
    return [*_STRICT, *defines, *shared]


def toolchain_paths() -> list[Path]:
    """Return the paths of the programs, libraries and headers of the compiler `cc`, without this package."""
    found = {Path(path) for path in _OTHERS}
    found |= {Path(path) for name in _PROGRAMS if (path := shutil.which(name))}
    for line in _lines_of("cc", "-print-search-dirs").splitlines():
        found |= {Path(path) for path in line.partition("=")[2].split(os.pathsep) if path.startswith("/")}
    for folders in _SEARCHED.findall(_lines_of("cc", "-E", "-v", "-x", "c", os.devnull)):
        found |= {Path(line.strip()) for line in folders.splitlines() if line.startswith(" /")}
    resolved = {path.resolve() for path in found if path.exists()}
    outermost = {path for path in resolved if not resolved & set(path.parents)}
    return sorted(each for path in outermost for each in _without_package(path))


def _without_package(path: Path) -> Iterator[Path]:
    """Yield a path. If it is a folder that contains this package, yield everything else in it instead."""
    if path not in (_PACKAGE, *_PACKAGE.parents):
        yield path
    elif path != _PACKAGE:
        for inside in path.iterdir():
            if not inside.is_symlink():
                yield from _without_package(inside)


def _lines_of(*command: str) -> str:
    """Return the lines that a command prints, in English."""
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
