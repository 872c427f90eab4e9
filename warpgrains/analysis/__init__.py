"""Quantities of a state, a step or a recording.

>>> from warpgrains import analysis
>>> analysis.coordination_number(simulation)

Every function takes a simulation or a snapshot, which may be of a simulation, of a state or of a frame of a
recording. Functions with a `region`, see `region_of`, count in the whole container by default. Functions
with `least` count only contacts with at least this force [N]. Units are SI; in two dimensions a stress is a
force per length.
"""

from warpgrains.analysis.contacts import grain_stresses, mean_stress, pressure
from warpgrains.analysis.correlations import radial_distribution, radius_classes
from warpgrains.analysis.energy import (
    EnergyBalance,
    contact_forces,
    granular_temperature,
    kinetic_energy,
    potential_energy,
    step_energy_balance,
)
from warpgrains.analysis.forces import contact_directions, fabric_tensor, force_distribution, force_statistics
from warpgrains.analysis.network import clusters, contact_numbers, coordination_number, rattlers, rigidity
from warpgrains.analysis.packing import (
    cell_areas,
    local_packing_fractions,
    packing_fraction,
    pile_height,
    pile_packing_fraction,
)
from warpgrains.analysis.profiles import Profile, height_profile, radial_profile
from warpgrains.analysis.quantities import find, quantities
from warpgrains.analysis.quantity_table import GROUPS, QUANTITIES
from warpgrains.analysis.region_table import grains_in, region_of
from warpgrains.analysis.series import Series
from warpgrains.analysis.snapshot import snapshot
from warpgrains.analysis.structure import structure_factor
from warpgrains.analysis.walls import WallForce, wall_forces, wall_places
from warpgrains.scene.snapshot import Snapshot
from warpgrains.space.region import Region

# fmt: off
__all__ = [
    "GROUPS", "QUANTITIES", "EnergyBalance", "Profile", "Region", "Series",
    "Snapshot", "WallForce",
    "cell_areas", "clusters", "contact_directions", "contact_forces", "contact_numbers",
    "coordination_number", "fabric_tensor", "find", "force_distribution", "force_statistics",
    "grain_stresses", "grains_in", "granular_temperature", "height_profile", "kinetic_energy",
    "local_packing_fractions", "mean_stress", "packing_fraction",
    "pile_height", "pile_packing_fraction", "potential_energy", "pressure", "quantities",
    "radial_distribution", "radial_profile", "radius_classes", "rattlers", "region_of", "rigidity",
    "snapshot", "step_energy_balance", "structure_factor", "wall_forces", "wall_places",
]
# fmt: on
