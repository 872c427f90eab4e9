"""Lengths of the arrays of scenes: one table (`lengths`), and the sizes that it depends on.

The solver allocates memory by this table only, so that a new array needs one line here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from warpgrains.base.arrays import IndexArray
from warpgrains.kernels.contacts import CHUNK
from warpgrains.kernels.record import Kind
from warpgrains.kernels.search.cells import AT_ONCE
from warpgrains.kernels.search.neighbors import TAKEN
from warpgrains.kernels.sweeps.pair_sweep import KEPT
from warpgrains.kernels.team.threads import GPU_PARTIALS
from warpgrains.walls.rim import Rim

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene

MANY_WALLS = 8  # number of walls above which a list begins with a capacity for fewer contacts a grain
FEW = 40  # number of grains up to which all pairs are tested, without a grid


@dataclass(frozen=True)
class Sizes:
    """Sizes that determine the lengths of a scene's arrays, of shape (scenes,) or one number for all."""

    grains: IndexArray
    contacts: IndexArray  # capacity of the list
    walls: IndexArray  # wall bodies (kernels/walls/walls.py)
    joined: IndexArray  # walls at all joints, each as often as it is one of the others there
    imaged: IndexArray  # 1 if a wall is an image of another one
    mobile: IndexArray  # 1 if a wall inside the domain moves as given in advance, or a force drives one
    driven: IndexArray  # 1 if a force drives a wall
    limited: IndexArray  # 1 if a wall has another side, or is round within a step (eq. 18)
    weighted: IndexArray  # 0 if grains take equal shares of every correction, and K_t = 3 in eq. 22
    history: IndexArray  # iterations of a step of which zeta and residual are kept
    accelerated: int  # 1 if sweeps are accelerated
    friction: int  # 1 if there is friction
    restitution: int  # 1 if contacts bounce
    rolling: int  # 1 if there is rolling friction
    team: int  # CPU threads that share a scene
    partials: int  # partial maxima and sums, one per thread

    @classmethod
    def first(cls, scenes: Sequence[Scene], team: int, device: wp.Device) -> Sizes:
        """Return the initial sizes of scenes of one kind."""
        n = np.array([scene.n for scene in scenes])
        of_walls = np.array([_of_walls(scene) for scene in scenes], np.int64).T
        walls, joined, imaged, mobile, driven, limited, weighted = of_walls
        return cls(
            n,
            first_pairs(n) + n * np.minimum(walls, MANY_WALLS),
            walls,
            joined,
            imaged,
            mobile,
            driven,
            limited,
            weighted,
            np.zeros_like(n),
            int(scenes[0].method != "gauss-seidel"),
            int(scenes[0].has_friction),
            int(scenes[0].has_restitution),
            int(scenes[0].has_rolling_friction),
            team,
            team if device.is_cpu else GPU_PARTIALS,
        )

    def fits(self, k: int, scene: Scene) -> bool:
        """Return True if the arrays of scene k fit another scene with the same grains and kind."""
        names = ("walls", "joined", "imaged", "mobile", "driven", "limited", "weighted")
        own = [int(getattr(self, name)[k]) for name in names]
        wanted = [*_of_walls(scene)]
        has_room, wanted[3] = own[3] >= wanted[3], own[3]
        return has_room and own == wanted

    def of(self, k: int) -> Sizes:
        """Return the sizes of scene k alone."""
        arrays = {name: value for name, value in vars(self).items() if isinstance(value, np.ndarray)}
        own: dict[str, Any] = {name: array[k : k + 1] for name, array in arrays.items()}
        return replace(self, **own)


def _of_walls(scene: Scene) -> tuple[int, ...]:
    """Return the fields of `Sizes` from `walls` to `weighted`, in order, for one scene."""
    bodies = scene.bodies
    has_equal_shares = scene.has_equal_masses and not scene.has_driven_walls
    if scene.has_friction:
        has_equal_shares = has_equal_shares and bool((scene.contact_mass == scene.rim_mass).all())
    return (
        len(bodies),
        sum(map(len, bodies.joints)),
        any(wall.image for wall in scene.walls),
        any(not isinstance(wall, Rim) for wall in scene.mobile_walls.values()),
        scene.has_driven_walls,
        bodies.circles[0] > 0.0 or bodies.is_round,
        not has_equal_shares,
    )


def kind_of(scene: Scene) -> Kind:
    """Return the options of a scene that choose its kernels: method, friction, restitution and rolling."""
    return Kind(scene.method, scene.has_friction, scene.has_restitution, scene.has_rolling_friction)


def first_pairs(n: IndexArray) -> IndexArray:
    """Return the initial capacity for pairs of n grains: 5 n (enough for most lists), at most all pairs."""
    return np.minimum(n * (n - 1) // 2, 5 * n)


def lengths(size: Sizes) -> dict[str, Any]:
    """Return the length of every array of a record, by struct and name. This is the only such table."""
    n, contacts = size.grains, size.contacts
    bodies = n + size.driven * size.walls
    cells = grid_width(n) ** 2 + 1
    friction = size.friction
    ahead = size.accelerated
    at_walls = np.minimum(n * size.walls, contacts)
    chunks = contacts + contacts // CHUNK + 2

    def of_contacts(swept: int, listed: int) -> dict[str, Any]:
        """Return the lengths of the arrays of a `Contacts`.

        The arguments are 1, 1 for the list, and `ahead`, 0 for the working set.
        """

        def correction(has: int) -> dict[str, IndexArray]:
            kept = dict.fromkeys(("start", "saved"), listed * has * contacts)
            return {"now": swept * has * contacts, "last": ahead * has * contacts, **kept}

        return {
            "contact": swept * contacts,
            "dv": correction(1),
            "dvt": correction(friction),
            "dvr": correction(size.rolling),
            "weights": swept * size.weighted * contacts,
            "rim_weights": swept * friction * size.weighted * contacts,
            "roll_weights": swept * size.rolling * contacts,
            "limits": swept * size.limited * at_walls,
            "wall_speed": listed * friction * size.mobile * at_walls,
            "set_start": listed * (contacts + 2),
        }

    return {
        "grains": {
            **dict.fromkeys(("position", "velocity", "free_velocity", "next_velocity"), bodies),
            **dict.fromkeys(
                ("recomputed_velocity", "last_position", "last_velocity", "contact_mass"), bodies
            ),
            **dict.fromkeys(("radius", "mass"), n),
            **dict.fromkeys(("spin", "last_spin", "angle", "rim_mass"), friction * n),
            **dict.fromkeys(("free_rim", "next_rim", "recomputed_rim"), friction * n),
        },
        "contacts": of_contacts(1, 1),
        "walls": {
            "shape": size.walls - 1,
            **dict.fromkeys(("joint", "joint_way"), size.joined),
            "image": size.imaged * (size.walls - 1),
            "joint_start": (size.joined > 0) * (2 * size.walls - 1),
            **dict.fromkeys(("motion", "pose"), size.mobile * (size.walls - 1)),
            "drive": size.driven * size.walls,
            "surface": friction * size.walls,
            "restitution": size.restitution * size.walls,
            "rolling": size.rolling * size.walls,
        },
        "verlet": {
            **dict.fromkeys(("peak_square", "peak_limit", "recent_deviation", "skin"), bodies),
            **dict.fromkeys(("reference_position", "reference_velocity"), bodies),
        },
        "momentum": {
            "last_rim": ahead * friction * n,
            "contact_sums": ahead * chunks,
            "last_velocity": ahead * bodies,
            "body_sums": ahead * -(-bodies // CHUNK),
        },
        "working": {
            "contacts": of_contacts(ahead, 0),
            "index": ahead * contacts,
            "mass": ahead * contacts * size.weighted,
            "range": ahead * chunks,
        },
        "grid": {
            "cell_start": cells,
            **dict.fromkeys(("x", "y", "extent"), n + AT_ONCE),
            **dict.fromkeys(("bucket", "grain", "velocity", "skin"), n),
        },
        "neighbors": {
            **dict.fromkeys(("start", "old_start"), n + 1),
            **dict.fromkeys(("neighbor", "old_neighbor", "by_second"), contacts),
            **dict.fromkeys(("sweep_index", "old_index", "set_of"), contacts),
            **dict.fromkeys(("row_sum", "taken"), n),
            "second": n + size.walls,
            "found": contacts + TAKEN * size.team,
            "slots": 1,
            "empty": size.team,
            "total": 1,
        },
        "partial": {
            **dict.fromkeys(("zeta", "residual", "overlap", "active"), size.partials),
            "kept_velocity": KEPT * size.team * (1 - ahead),
        },
        **dict.fromkeys(("zeta_history", "residual_history"), size.history),
    }


def grid_width(n: Any) -> Any:
    """Return the number of cells per side of the grid for n grains; it is 1 for few grains."""
    return np.where(n <= FEW, 1, 1 << np.ceil(np.log2(n) / 2).astype(np.int64))
