"""Conversion of records to tables of other libraries, which the extra ``[data]`` installs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from warpgrains.base.errors import requiring

if TYPE_CHECKING:
    import pandas
    import xarray

COMPONENTS = {"pair": ("i", "j"), "wall": ("grain", "wall")}
"""Names of the two columns of a field, by its name; those of other vector fields end in _x and _y."""


def library(name: str, what: str) -> Any:
    """Import and return the library `name` of the extra ``[data]``.

    If it is not installed, raises MissingExtraError, which says that `what` needs it.
    """
    with requiring(what, "data"):
        return import_module(name)


def dataset(frame: pandas.DataFrame, units: Mapping[str, str]) -> xarray.Dataset:
    """Return a DataFrame as a dataset over its index. InputError without xarray.

    `units` holds the units of columns by name; columns without one have no attribute "units".
    """
    library("xarray", "to_xarray")
    found = frame.to_xarray()
    for name in units.keys() & found.variables.keys():
        found[name].attrs["units"] = units[name]
    return found


class Tabular:
    """Base class of records that become tables.

    Each field is an array with one entry per row, or a single value.
    """

    def to_pandas(self) -> pandas.DataFrame:
        """Return the record as a DataFrame with one column per number, in the units of its fields.

        Raises
        ------
        InputError
            pandas is not installed; the extra ``[data]`` installs it.
        """
        columns: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if not field.metadata.get("tabular", True):
                continue
            if isinstance(value, np.ndarray) and value.ndim == 2:
                names = COMPONENTS.get(field.name, (f"{field.name}_x", f"{field.name}_y"))
                columns |= dict(zip(names, value.T, strict=True))
            else:
                columns[field.name] = value if isinstance(value, np.ndarray) else [value]
        return library("pandas", "to_pandas").DataFrame(columns)
