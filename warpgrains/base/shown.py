"""Representation of objects: a line in a terminal, a small table in a notebook."""

from html import escape


def number_of(number: int, noun: str) -> str:
    """Return a number of things, such as "1 frame" or "2 frames"."""
    return f"{number} {noun}{'s' * (number != 1)}"


class Shown:
    """Base class of objects that are shown by a few named values."""

    def summary(self) -> dict[str, str]:
        """Return the values to show, with units, by name."""
        raise NotImplementedError

    def __repr__(self) -> str:
        text = ", ".join(f"{name} {value}".strip() for name, value in self.summary().items())
        return f"{type(self).__name__}({text})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align: left'>{escape(name)}</th>"
            f"<td style='text-align: left'>{escape(value)}</td></tr>"
            for name, value in self.summary().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
