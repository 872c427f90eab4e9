"""Exhibits: functions that draw a picture and return the numbers it shows, and a program for them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from warpgrains.scenes.style import STYLE

Numbers = dict[str, float]
Exhibits = Mapping[str, Callable[[Path], Numbers]]


def draw_exhibits(
    exhibits: Exhibits, description: str | None, folder: str, arguments: Sequence[str] | None
) -> dict[str, Numbers]:
    """Draw the exhibits that the arguments name, by default all, and print their numbers."""
    from matplotlib import rc_context

    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("-o", "--output", metavar="DIR", default=folder)
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"of {', '.join(exhibits)}")
    chosen = parser.parse_args(arguments)
    output = Path(chosen.output)
    output.mkdir(parents=True, exist_ok=True)
    found = {}
    for name in chosen.names or exhibits:
        with rc_context(STYLE):
            found[name] = exhibits[name](output / f"{name}.png")
        print(name)
        for what, value in found[name].items():
            print(f"  {what:<40} {value:.6g}")
    return found
