"""A known mistake: what stands in the reference (grains.c), and what instead."""

from typing import NamedTuple

from warpgrains.reference.reference import SOURCE


class Mistake(NamedTuple):
    """A mistake.

    Attributes
    ----------
    name : str
    function : str
        The one that it is in.
    advice : str
        What to look at.
    changes : tuple
        What stands in the reference, and what instead.
    """

    name: str
    function: str
    advice: str
    changes: tuple[tuple[str, str], ...]

    def source(self) -> str:
        """Return the reference with this mistake."""
        text = SOURCE.read_text()
        for right, wrong in self.changes:
            assert text.count(right) == 1, (self.name, right)
            text = text.replace(right, wrong)
        return text
