"""Fields of records, written once: docstrings, checks, files and ``--help`` read what is said here."""

import inspect
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import MISSING, Field, field, fields
from typing import Any, TypeVar

Documented = TypeVar("Documented", bound=Callable[..., Any])


def described(meaning: str, *, default: Any = MISSING, **more: Any) -> Any:
    """Return a field of a dataclass with its meaning and its unit, "[m]", and what else its readers need."""
    return field(default=default, metadata={"meaning": meaning, **more})


def described_fields(record: type) -> dict[str, Field[Any]]:
    """Return the described fields of a dataclass by name."""
    return {own.name: own for own in fields(record) if "meaning" in own.metadata}


def documented(parameters: Iterable[Field[Any]]) -> Callable[[Documented], Documented]:
    """Put parameters in the place of ``{fields}`` in a docstring, each as the numpy convention has it."""
    wrap = textwrap.TextWrapper(100, initial_indent="    ", subsequent_indent="    ").fill
    text = "\n".join(f"{one.name}\n{wrap(one.metadata['meaning'])}" for one in parameters)

    def document(what: Documented) -> Documented:
        what.__doc__ = (inspect.getdoc(what) or "").replace("{fields}", text)
        return what

    return document
