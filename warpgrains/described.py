"""Fields of records, each with a description.

Docstrings, checks, files and ``--help`` are generated from these descriptions, so that each is written once.
"""

import inspect
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import MISSING, Field, field, fields
from typing import Any, TypeVar

Documented = TypeVar("Documented", bound=Callable[..., Any])


def described(meaning: str, *, default: Any = MISSING, **more: Any) -> Any:
    """Return a dataclass field with its meaning, including the unit such as "[m]", and further metadata."""
    return field(default=default, metadata={"meaning": meaning, **more})


def described_fields(record: type) -> dict[str, Field[Any]]:
    """Return the described fields of a dataclass by name."""
    return {own.name: own for own in fields(record) if "meaning" in own.metadata}


def documented(parameters: Iterable[Field[Any]]) -> Callable[[Documented], Documented]:
    """Replace ``{fields}`` in a docstring by parameters in the numpy convention."""
    wrap = textwrap.TextWrapper(100, initial_indent="    ", subsequent_indent="    ").fill
    text = "\n".join(f"{one.name}\n{wrap(one.metadata['meaning'])}" for one in parameters)

    def document(what: Documented) -> Documented:
        what.__doc__ = (inspect.getdoc(what) or "").replace("{fields}", text)
        return what

    return document
