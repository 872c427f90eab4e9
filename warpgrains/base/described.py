"""Fields of records, each with a description.

Docstrings, checks, files and ``--help`` are generated from these descriptions, so that each is written once.
"""

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, field, fields
from itertools import pairwise
from typing import Any, Self, TypeVar

from warpgrains.base import checks
from warpgrains.base.errors import InputError

Kind = TypeVar("Kind")
Documented = TypeVar("Documented", bound=Callable[..., Any])


def described(meaning: str, *, default: Any = MISSING, **more: Any) -> Any:
    """Return a dataclass field with its `meaning`, including the unit such as "[m]", and more metadata."""
    return field(default=default, metadata={"meaning": meaning, **more})


class Described:
    """Base class of dataclasses that raises InputError for an unknown or a missing keyword."""

    def __new__(cls, *values: Any, **given: Any) -> Self:
        own = [one for one in fields(cls) if one.init]  # type: ignore[arg-type]
        for name in given:
            checks.one_of(f"keyword of {cls.__name__}", name, [one.name for one in own])
        by_place = [one.name for one in own if not one.kw_only]
        if len(values) > len(by_place):
            raise InputError(
                f"{cls.__name__} takes {len(by_place)} values without keyword, not {len(values)}"
            )
        placed = by_place[: len(values)]
        for one in own if given or values else ():  # copies are made without any
            if one.name not in (*given, *placed) and one.default is MISSING is one.default_factory:
                told = f"{one.name}: {one.metadata['meaning']}" if "meaning" in one.metadata else one.name
                raise InputError(f"{cls.__name__} needs {told}")
        return super().__new__(cls)


def described_fields(record: type) -> dict[str, Field[Any]]:
    """Return the described fields of a dataclass by name."""
    return {own.name: own for own in fields(record) if "meaning" in own.metadata}


def checked(field: str, own: Field[Any], value: Any) -> Any:
    """Return the result of the check of the described field `own` for `value`; messages name `field`.

    None needs no check if it is the default of `own`.
    """
    return None if value is None and own.default is None else own.metadata["check"](field, value)


def fields_of(
    field: str, table: Mapping[str, Any], one: str, keys: Mapping[str, Field[Any]]
) -> dict[str, Any]:
    """Return the values of `table` by name of field; `keys` gives the described field of each key.

    Raises InputError if a key is unknown, or missing and without a default. Messages name the table `field`,
    and call the object that it describes `one`.
    """
    for key in table:
        checks.one_of(f"key of {field}", key, keys)
    for key, known in keys.items():
        if key not in table and known.default is MISSING:
            raise InputError(f"{field}.{key} is missing: {one} needs it{known.metadata.get('such', '')}")
    return {keys[key].name: given for key, given in table.items()}


FIELDS_IN_HELP = "Fields:"
"""Line after which a docstring lists fields. Pages omit this list, because they show fields anyway."""


class _WithFields:
    """Descriptor of `__doc__`: the docstring of a class, followed by the docstrings of its fields.

    The latter are read from the source only when `__doc__` is read.
    """

    def __init__(self, text: str):
        self._text = text

    def __get__(self, instance: object, kind: type) -> str:
        docs = {name: text for base in reversed(kind.__mro__) for name, text in _field_docs(base).items()}
        lines = (textwrap.indent(f"{name} : {text}", "    ")[4:] for name, text in docs.items())
        return "\n\n".join([inspect.cleandoc(self._text), FIELDS_IN_HELP, *lines])


def fields_in_help(kind: type[Kind]) -> type[Kind]:
    """Let `help()` of a class show the docstrings of its fields."""
    kind.__doc__ = _WithFields(kind.__doc__ or "")  # type: ignore[assignment]
    return kind


def _field_docs(kind: type) -> dict[str, str]:
    """Return the docstrings after fields of a class, by name; {} if the source is not available."""
    try:
        body = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    except (OSError, TypeError):
        return {}
    found = {}
    for own, following in pairwise(body.body if isinstance(body, ast.ClassDef) else ()):
        match own, following:
            case ast.AnnAssign(target=ast.Name(name)), ast.Expr(ast.Constant(str(text))):
                found[name] = inspect.cleandoc(text)
    return found


def documented(parameters: Iterable[Field[Any]]) -> Callable[[Documented], Documented]:
    """Return a decorator that replaces ``{fields}`` in a docstring by descriptions of `parameters`.

    They have the form of parameters in numpy style.
    """
    wrap = textwrap.TextWrapper(100, initial_indent="    ", subsequent_indent="    ").fill
    text = "\n".join(f"{one.name}\n{wrap(one.metadata['meaning'])}" for one in parameters)

    def document(what: Documented) -> Documented:
        what.__doc__ = (inspect.getdoc(what) or "").replace("{fields}", text)
        return what

    return document
