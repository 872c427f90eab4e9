"""The commands and their options, read from commands.toml."""

import tomllib
from argparse import ArgumentParser, ArgumentTypeError, BooleanOptionalAction, Namespace
from collections.abc import Callable, Collection, Iterator
from importlib import import_module
from itertools import chain
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple, get_args, get_type_hints

from warpgrains.base.console import exit_on_interrupt
from warpgrains.drawing.kinds import FILM, STILL
from warpgrains.drawing.looks import DEFAULT_RATE, Looks
from warpgrains.simulation.options import FLAGS, OPTIONS, RunOptions

_VALUES = {"rate": DEFAULT_RATE, "still": STILL.listed, "film": FILM.listed}

Option = dict[str, Any]
"""An option or argument: its `name`, `group` and `rivals`, and arguments of `ArgumentParser.add_argument`."""


class Command(NamedTuple):
    """A command of the command line; commands.toml explains the fields."""

    home: str
    help: str
    description: str
    example: str
    options: list[Option]

    def add_options(self, parser: ArgumentParser) -> None:
        places: dict[tuple[str, str], Any] = {("", ""): parser}
        for given in self.options:
            option = {"group": "", "rivals": "", **_SHARED.get(given["name"], {}), **given}
            names, group, rivals = (option.pop(key) for key in ("name", "group", "rivals"))
            if (group, "") not in places:
                places[group, ""] = parser.add_argument_group(group)
            if (group, rivals) not in places:
                places[group, rivals] = places[group, ""].add_mutually_exclusive_group()
            option["help"] = option["help"].format(**_VALUES).replace("%", "%%")
            if "type" in option:
                option["type"] = _TYPES[option["type"]]
            places[group, rivals].add_argument(*names.split(), **option)

    def do(self, arguments: Namespace) -> int:
        """Execute the command and return the exit code. The module of the command is imported only here."""
        module, _, function = self.home.partition(".")
        with exit_on_interrupt():
            do = getattr(import_module(f"warpgrains.cli.{module}"), function)
        return int(do(arguments))


def _outputs(names: Collection[str], shown: str | None = None) -> Iterator[Option]:
    """Yield command-line options for the named fields of `RunOptions`, in groups of related options.

    The help shows `shown` as their default, if given.
    """
    groups = {"record": "looks", "measure": "series", "series": "series", "checkpoint": "checkpoints"}
    types = get_type_hints(RunOptions)
    for name in names:
        default, about, flag = OPTIONS[name].default, OPTIONS[name].metadata, FLAGS[name]
        option: Option = {"dest": name, "group": groups.get(about["needs"] or name, "")}
        meaning = about["meaning"][0].lower() + about["meaning"][1:-1]
        meaning += f" (default: {shown or default})" if shown or default else ""
        if name == "every":
            meaning += f", and two rows of a series (default: {OPTIONS['measure_every'].default})"
        (kind,) = set(get_args(types[name]) or [types[name]]) - {NoneType}
        value: Option = {"metavar": about["metavar"], "type": kind.__name__}
        if kind is bool:
            value = {"action": BooleanOptionalAction}
        yield option | value | {"name": f"-o {flag}" if name == "record" else flag, "help": meaning}


def _parser_of(convert: Callable[[str], Any], told: str) -> Callable[[str], Any]:
    """Return a `type` of argparse: a function that calls `convert` for the text of an option.

    If that raises ValueError, the error says that the text is not `told`, such as "a number".
    """

    def converted(text: str) -> Any:
        try:
            return convert(text)
        except ValueError:
            raise ArgumentTypeError(f"{text!r} is not {told}") from None

    return converted


_TYPES = {
    "int": _parser_of(int, "a whole number such as 100"),
    "float": _parser_of(float, "a number such as 0.5"),
    "str": str,
    "whole numbers": _parser_of(
        lambda text: [int(word) for word in text.split(",")], "a list of whole numbers such as 0,20,-1"
    ),
}
_TABLE = tomllib.loads((Path(__file__).parent / "commands.toml").read_text())
_SHARED = _TABLE.pop("shared")
_OUTPUTS = {"RunOptions": _outputs(FLAGS), "looks": _outputs(Looks.__annotations__, "as recorded")}
for _row in _TABLE.values():
    _options = ([one] if isinstance(one, dict) else _OUTPUTS[one] for one in _row["options"])
    _row["options"] = [*chain.from_iterable(_options)]
COMMANDS = {name: Command(**row) for name, row in _TABLE.items()}
