"""All messages of the package, read from its source, each with an example.

A message is a text given to an exception, to `warn`, to `print` or to `Words` (texts of the grader in two
languages), or yielded by `check`. The values in it are constants of its module, or samples from
tests/robustness/messages.toml. Help texts come from the parser and the keys of scenes.
"""

import ast
import importlib
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from warpgrains.cli.main import _parser
from warpgrains.scene.fields import FIELDS

ROOT = Path(__file__).parents[2]
SAMPLES = tomllib.loads((ROOT / "tests/robustness/messages.toml").read_text())

_TEXT = ast.JoinedStr | ast.Constant
_RECEIVERS = re.compile(r"(Error|warn|print|Words|KeyboardInterrupt)$")


class Message(NamedTuple):
    """A message, with its place, the function that it is given to, and its values without a sample."""

    file: str
    line: int
    given_to: str
    example: str
    unknown: tuple[str, ...]


def help_texts() -> dict[str, str]:
    """Return the help of every command and option, and the meaning of every key of a scene file."""
    commands = next(iter(_parser()._subparsers._group_actions)).choices
    texts = {f"warpgrains {name}": command.description for name, command in commands.items()}
    for name, command in commands.items():
        for option in command._actions:
            texts[f"warpgrains {name} {'/'.join(option.option_strings) or option.dest}"] = option.help
    return texts | {f"scene: {name}": field.metadata["meaning"] for name, field in FIELDS.items()}


def messages() -> list[Message]:
    """Return all messages, in the order of the source."""
    paths = sorted((ROOT / "warpgrains").rglob("*.py"))
    return [message for path in paths for message in _of_file(path)]


def _of_file(path: Path) -> Iterator[Message]:
    name = str(path.relative_to(ROOT / "warpgrains"))
    module = None
    for node in ast.walk(ast.parse(path.read_text())):
        for receiver, text in _texts(node):
            module = module or importlib.import_module(
                f"warpgrains.{name[:-3]}".replace("/", ".").removesuffix(".__init__")
            )
            example, unknown = _example(text, vars(module), SAMPLES | SAMPLES.get(name, {}))
            if " " in example.strip():
                yield Message(name, node.lineno, receiver, example, tuple(unknown))


def _texts(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Yield the texts of a call or a yield, each with the name of the function that it is given to."""
    if isinstance(node, ast.Yield) and isinstance(node.value, _TEXT):
        yield "yield", node.value
    if isinstance(node, ast.Call):
        receiver = ast.unparse(node.func).rpartition(".")[2]
        if _RECEIVERS.search(receiver):
            texts = [text for given in node.args for text in ast.walk(given) if isinstance(text, _TEXT)]
            inner = {id(part) for text in texts for part in ast.walk(text) if part is not text}
            yield from ((receiver, text) for text in texts if id(text) not in inner)


def _example(text: ast.expr, names: dict[str, object], samples: dict[str, object]) -> tuple[str, list[str]]:
    """Return a text with its values filled in, and the values without a sample, which stand in <>."""
    if isinstance(text, ast.Constant):
        return text.value if isinstance(text.value, str) else "", []
    assert isinstance(text, ast.JoinedStr)
    parts, unknown = [], []
    for part in text.values:
        if isinstance(part, ast.Constant):
            parts.append(str(part.value))
            continue
        assert isinstance(part, ast.FormattedValue)
        expression = ast.unparse(part.value)
        value = samples.get(expression, names.get(expression) if expression.strip("_").isupper() else None)
        if value is None:
            unknown.append(expression)
            parts.append(f"<{expression}>")
            continue
        spec = "" if part.format_spec is None else ast.unparse(part.format_spec)[2:-1]
        parts.append(repr(value) if part.conversion == ord("r") else format(value, spec))
    return "".join(parts), unknown
