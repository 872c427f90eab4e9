"""The command line: reads it, has the command done, and tells in one line why it was not."""

import os
import sys
from argparse import ArgumentParser
from collections.abc import Sequence
from typing import NoReturn

from warpgrains import __version__
from warpgrains.cli.commands import COMMANDS
from warpgrains.console import INTERRUPTED, STDOUT, open_standard_streams
from warpgrains.errors import SceneError, SimulationError

DONE, FAILED, BAD_INPUT = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments
        What follows the command's name; by default those of this process.

    Returns
    -------
    int
        0 done, 1 failed, 2 bad input, 130 interrupted. The reason is one line on standard error.
    """
    open_standard_streams()
    try:
        parsed = _parser().parse_args(arguments)
        if parsed.command is None:
            _parser().print_help()
            return DONE
        code = parsed.command.do(parsed)
        sys.stdout.flush()
        return code
    except SceneError as error:
        return _complain(str(error), BAD_INPUT)
    except BrokenPipeError:  # nobody reads the output any more; Python must not try again at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), STDOUT)
        return FAILED
    except (SimulationError, OSError) as error:
        return _complain(str(error), FAILED)
    except KeyboardInterrupt as interrupt:  # it may say how to go on
        return _complain("; ".join(["interrupted", *map(str, interrupt.args)]), INTERRUPTED)


class _Parser(ArgumentParser):
    """A parser whose complaints are one line, like all others."""

    def error(self, message: str) -> NoReturn:
        sys.exit(_complain(message, BAD_INPUT))


def _complain(message: str, code: int) -> int:
    line = " ".join(message.encode(errors="backslashreplace").decode().splitlines())
    print(f"warpgrains: error: {line}", file=sys.stderr)
    return code


def _parser() -> ArgumentParser:
    parser = _Parser(
        prog="warpgrains", description="Rigid frictionless grains in an annulus, on NVIDIA Warp."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    parser.set_defaults(command=None)
    subparsers = parser.add_subparsers(metavar="COMMAND")
    for name, command in COMMANDS.items():
        own = subparsers.add_parser(name, help=command.help, description=command.description)
        own.set_defaults(command=command)
        command.add_options(own)
    return parser
