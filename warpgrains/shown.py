"""How objects show themselves: a line in a terminal, a small table in a notebook."""

from html import escape


class Shown:
    """What tells of itself in a few facts."""

    def facts(self) -> dict[str, str]:
        """Return what there is to tell, with units, by name."""
        raise NotImplementedError

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value}".strip() for name, value in self.facts().items())
        return f"{type(self).__name__}({told})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><th style='text-align: left'>{escape(name)}</th>"
            f"<td style='text-align: left'>{escape(value)}</td></tr>"
            for name, value in self.facts().items()
        )
        return f"<table><caption>{type(self).__name__}</caption>{rows}</table>"
