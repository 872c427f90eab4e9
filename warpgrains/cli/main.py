"""Entry point of the command line: parses arguments, executes the command, prints errors on one line."""

import os
import re
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from errno import EDQUOT, EFBIG, EIO, ENOSPC
from typing import Any, NoReturn

from warpgrains import __version__
from warpgrains.base import checks
from warpgrains.base.console import INTERRUPTED, STDOUT, open_standard_streams, printable
from warpgrains.base.errors import InputError, SimulationError, requiring, written_as
from warpgrains.cli.commands import COMMANDS

DONE, FAILED, BAD_INPUT = 0, 1, 2
_FULL = (ENOSPC, EDQUOT, EFBIG, EIO)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return 0, 1 for failure, 2 for bad input, or 130 if interrupted."""
    open_standard_streams()
    try:
        code = _do(arguments)
        sys.stdout.flush()
        return code
    except InputError as error:
        return _complain(str(error), BAD_INPUT)
    except BrokenPipeError:  # the reader has closed the pipe; Python must not flush again at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
        return FAILED
    except OSError as error:
        return _complain(_reason(error), FAILED)
    except SimulationError as error:
        return _complain(str(error), FAILED)
    except MemoryError as error:
        return _complain(": ".join(["out of memory", *map(str, error.args)]), FAILED)
    except KeyboardInterrupt as interrupt:  # its message may say how to continue
        return _complain("; ".join(["interrupted", *map(str, interrupt.args)]), INTERRUPTED)


def _do(arguments: Sequence[str] | None) -> int:
    words, parser = list(sys.argv[1:] if arguments is None else arguments), _parser()
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    try:
        parsed, unknown = parser.parse_known_args(words)
    except SystemExit:  # after --help or --version
        sys.stdout.flush()
        raise
    if unknown:
        own, names = "", ["--completion", "--help", "--version"]
        if parsed.command is not None:
            own, names = f" {words[0]}", " ".join(one["name"] for one in parsed.command.options).split()
        if unknown[0].startswith("-"):
            known = [name for name in names if name[0] == "-"]
            checks.one_of(f"option of warpgrains{own}", unknown[0].partition("=")[0], known)
        raise InputError(f"{unknown[0]!r} is one too many: `warpgrains{own} --help` shows what it takes")
    if parsed.completion is not None:
        with requiring("--completion", "shell"):
            import shtab
        print(shtab.complete(parser, parsed.completion))
        return DONE
    if parsed.command is None:
        parser.print_help()
        return DONE
    for one in parsed.command.options:
        flags = [name for name in one["name"].split() if name[0] == "-"]
        is_repeated = sum(word.partition("=")[0] in flags for word in words) > 1
        if is_repeated and one["name"] != "--set":
            raise InputError(f"{flags[-1]} is given twice: give it once")
    with written_as({"override": "--set", "quantity": "--measure", "until": "--until", "region": "--region"}):
        return parsed.command.do(parsed)


def _reason(error: OSError) -> str:
    """Return the message of an OSError. If the disk is full and no file is named, it is standard output."""
    if error.filename is not None:
        return f"'{error.filename}': {error.strerror}"
    if error.errno not in _FULL:
        return str(error)
    os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)  # Python must not flush it again at exit
    return f"standard output cannot be written: {error.strerror}"


class _Parser(ArgumentParser):
    """A parser that prints errors on one line, as commands do, and that accepts "-1,2" as a value."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options, allow_abbrev=False)
        self._negative_number_matcher = re.compile(r"-\.?\d")

    def error(self, message: str) -> NoReturn:
        if found := re.match(r"argument COMMAND: invalid choice: '([^']+)'", message):
            from warpgrains.scene.toml import shipped_scenes  # slow to import

            if found[1] in shipped_scenes() or found[1].endswith(".toml"):
                message = f"unknown command {found[1]!r}: did you mean `warpgrains run {found[1]}`?"
        elif re.search("expected|required", message):
            message = f"{message}: `{self.prog} --help` explains it"
        sys.exit(_complain(message, BAD_INPUT))


def _complain(message: str, code: int) -> int:
    line = printable(" ".join(message.splitlines()))
    print(f"warpgrains: error: {line}", file=sys.stderr)
    return code


def _parser() -> ArgumentParser:
    parser = _Parser(
        prog="warpgrains",
        description="Rigid grains in an annulus or a box, with or without friction, on NVIDIA Warp.",
        epilog="warpgrains help COMMAND explains a command.",
    )
    meaning = "print what completes commands in bash, zsh or tcsh"
    parser.add_argument("--completion", metavar="SHELL", choices=("bash", "zsh", "tcsh"), help=meaning)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.set_defaults(command=None)
    subparsers = parser.add_subparsers(metavar="COMMAND")
    for name, command in COMMANDS.items():
        example = f"Example: {command.example}"
        own = subparsers.add_parser(name, help=command.help, description=command.description, epilog=example)
        own.set_defaults(command=command)
        command.add_options(own)
    return parser
