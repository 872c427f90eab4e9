"""What a scene needs: the kernels are compiled for it, and what it does not need is not in them."""

from dataclasses import dataclass, fields

import warp as wp

OPTIONS = {"enable_backward": False, "fuse_fp": False}


@dataclass(frozen=True)
class Variant:
    """The features that a scene has. Each one absent leaves its arithmetic and its arrays out."""

    gravity: bool
    drag: bool
    inner_wall: bool
    distinct_radii: bool
    distinct_masses: bool
    accelerated: bool

    @property
    def module(self) -> wp.Module:
        """The Warp module in which all kernels of this variant live, so that they are compiled together."""
        features = [field.name for field in fields(self) if getattr(self, field.name)]
        module = wp.get_module("_".join(["warpgrains.kernels", *features]))
        wp.set_module_options(OPTIONS, module)
        return module
