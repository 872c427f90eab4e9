"""What the contacts carry, in the units of forces (kernels/MODEL.md, eq. 9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.scene.geometry import pair_gaps, pair_normals
from warpgrains.scene.walls import outward
from warpgrains.tables import Tabular

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import Corrections


@dataclass(frozen=True, eq=False)
class PairContacts(Tabular):
    """Contacts between grains during the last step: the pairs that carry a correction.

    Examples
    --------
    >>> contacts = simulation.contacts()
    >>> contacts.pair.shape, contacts.normal.shape, f"{contacts.force.max():.4f} N"
    ((15, 2), (15, 2), '2.0264 N')
    """

    pair: IntArray
    """Grains i < j, in lexicographic order, shape (m, 2)."""
    normal: FloatArray
    """Unit normals from i to j, shape (m, 2)."""
    gap: FloatArray
    """Free distances at the start of the step [m], shape (m,)."""
    correction: FloatArray
    """Accumulated corrections dv_c [m/s], shape (m,)."""
    force: FloatArray
    """M_i M_j / (M_i + M_j) dv_c / dt, along the normal on j and against it on i [N], shape (m,).

    M are the contact masses of the scene."""


@dataclass(frozen=True, eq=False)
class WallContacts(Tabular):
    """Contacts with the walls during the last step, one entry a grain.

    Examples
    --------
    >>> force = simulation.wall_contacts().force
    >>> force.shape, int((force > 0.0).sum())  # grains that the outer wall carries
    ((15,), 10)
    """

    grain: IntArray
    """The grains, 0 to n - 1, shape (n,)."""
    normal: FloatArray
    """Unit normals of both walls at each grain, away from the origin, shape (n, 2); 0 for a grain there."""
    correction: FloatArray
    """Accumulated corrections dv_b [m/s], shape (n,), > 0 at the outer wall, < 0 at the inner one."""
    force: FloatArray
    """M_i dv_b / dt, M the contact masses of the scene, against the normal [N], shape (n,)."""


def pair_contacts(scene: Scene, position: FloatArray, corrections: Corrections) -> PairContacts:
    """Return the contacts between grains, whose centres were at `position` [m], shape (n, 2)."""
    i, j = corrections.pair.T
    mass = scene.contact_mass
    mass_i, mass_j = mass[i], mass[j]
    return PairContacts(
        pair=corrections.pair,
        normal=pair_normals(position, i, j),
        gap=pair_gaps(position, scene.radius, i, j),
        correction=corrections.pair_correction,
        force=mass_i * mass_j / (mass_i + mass_j) * corrections.pair_correction / scene.dt,
    )


def wall_contacts(scene: Scene, position: FloatArray, corrections: Corrections) -> WallContacts:
    """Return the contacts with the walls, of grains whose centres were at `position` [m], shape (n, 2)."""
    with np.errstate(invalid="ignore"):  # at the origin no direction is outward
        normal = np.nan_to_num(outward(position))
    return WallContacts(
        grain=np.arange(scene.n, dtype=np.int32),
        normal=normal,
        correction=corrections.wall_correction,
        force=wall_forces(scene.contact_mass, corrections.wall_correction, scene.dt),
    )


def wall_forces(contact_mass: FloatArray, correction: FloatArray, dt: FloatArray | float) -> FloatArray:
    """Return M_i dv_b / dt [N], of contact masses M [kg] and corrections dv_b [m/s]; shapes (..., n)."""
    return contact_mass * correction / dt
