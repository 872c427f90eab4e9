"""The custom data of a recording: the scene, and what is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import warpgrains
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colors import ColorScale
from warpgrains.scene import checks
from warpgrains.scene.document import parameters_text, read_parameters

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

RECORDED_BY = "warpgrains"
"""Key in a layer's custom data that identifies a recording."""


class Metadata(NamedTuple):
    """What a recording holds beside its prims."""

    parameters: dict[str, Any]
    """Fields of the scene, except those of grains."""
    first_step: int
    """Time steps before the first frame."""
    colors: ColorScale | None
    """Range of values that the colors represent; None for the palette."""
    forces: ChainScale | None
    """Scale from forces to widths; None if no force chains were recorded."""

    @classmethod
    def read(cls, data: Mapping[str, Any]) -> Self:
        """Return the metadata in the form of `described`."""
        parameters = read_parameters(str(data["parameters"]))
        parameters |= {"name": str(data["name"]), "text": str(data["scene"])}
        return cls(
            parameters,
            checks.whole_number("first_step", data["first_step"], least=0),
            ColorScale.read(data["colors"]) if "colors" in data else None,
            ChainScale.read(data["forces"]) if "forces" in data else None,
        )


def described(
    scene: Scene, first_step: int, draw_as: str, colors: ColorScale | None, forces: ChainScale | None
) -> dict[str, Any]:
    """Return the custom data of a recording. A run continues only one of the same data, see `identity`."""
    scales = {"colors": colors, "forces": forces}
    return {
        "version": warpgrains.__version__,
        "name": scene.name,
        "scene": scene.text,
        "parameters": parameters_text(scene),
        "draw_as": draw_as,
        "first_step": first_step,
        **{name: scale.described() for name, scale in scales.items() if scale is not None},
    }
