"""The file of a recording: its lock, and its custom data, which are the scene and what is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from pxr import Sdf, Tf

import warpgrains
from warpgrains.drawing.chains import ChainScale
from warpgrains.drawing.colors import ColorScale
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.errors import InputError
from warpgrains.files import require_writable_path
from warpgrains.locks import Lock, lock_own
from warpgrains.scene import checks
from warpgrains.scene.toml import parameters_text, read_parameters

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

RECORDED_BY = "warpgrains"
"""Key in a layer's custom data that identifies a recording."""


class Metadata(NamedTuple):
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


def lock_output(path: Path) -> Lock:
    """Lock a recording for writing. Raises InputError unless it can be written and replaces no other file."""
    require_writable_path("output", path, *RECORDINGS)
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise InputError(f"output '{path}' is not UTF-8: USD cannot write a file of this name") from None
    return lock_own(path, _is_recording, "recording of warpgrains")


def _is_recording(path: Path) -> bool:
    try:
        layer = Sdf.Layer.OpenAsAnonymous(str(path), metadataOnly=True)
    except Tf.ErrorException:
        return False
    return layer is not None and RECORDED_BY in layer.customLayerData
