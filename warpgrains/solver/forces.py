"""Forces of contacts, from their corrections (kernels/MODEL.md, eq. 9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from warpgrains.arrays import FloatArray, IntArray
from warpgrains.scene.geometry import pair_gaps, pair_normals
from warpgrains.tables import Tabular

if TYPE_CHECKING:
    from warpgrains.scene.scene import Scene
    from warpgrains.scene.state import Corrections


@dataclass(frozen=True, eq=False)
class PairContacts(Tabular):
    """Contacts between grains that carry a correction after the last step.

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
    """Gaps at the start of the step [m], shape (m,)."""
    correction: FloatArray
    """Accumulated corrections dv_c [m/s], shape (m,)."""
    force: FloatArray
    """M_i M_j / (M_i + M_j) dv_c / dt, along the normal on j and against it on i [N], shape (m,).

    M are the contact masses of the scene."""


@dataclass(frozen=True, eq=False)
class WallContacts(Tabular):
    """Wall contacts that carry a correction after the last step.

    Examples
    --------
    >>> contacts = simulation.wall_contacts()
    >>> contacts.wall.shape, contacts.force.shape, f"{contacts.force.max():.4f} N"
    ((10, 2), (10,), '2.0098 N')
    """

    wall: IntArray
    """Grain and wall of each, shape (m, 2): 0 is the outer wall, 1 the inner one, 2, 3, ... those of
    `Scene.walls`."""
    normal: FloatArray
    """Unit normals from the grain into the wall, shape (m, 2)."""
    gap: FloatArray
    """Gaps at the start of the step [m], shape (m,)."""
    correction: FloatArray
    """Accumulated corrections [m/s], shape (m,), > 0."""
    force: FloatArray
    """M_i dv / dt, against the normal [N], shape (m,). M are the contact masses of the scene."""


def pair_contacts(scene: Scene, position: FloatArray, corrections: Corrections) -> PairContacts:
    """Return the contacts between grains, whose centers were at `position` [m], shape (n, 2)."""
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
    """Return the contacts with the walls, of grains whose centers were at `position` [m], shape (n, 2)."""
    normal, gap = scene.wall_frames(position, corrections.wall)
    return WallContacts(
        wall=corrections.wall,
        normal=normal,
        gap=gap,
        correction=corrections.wall_correction,
        force=scene.contact_mass[corrections.wall[:, 0]] * corrections.wall_correction / scene.dt,
    )
