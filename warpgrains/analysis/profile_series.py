"""Profiles of a simulation during a run, and their means over time."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from warpgrains.analysis.profiles import Profile, height_profile, radial_profile
from warpgrains.analysis.region_table import Where
from warpgrains.analysis.series import block_average
from warpgrains.analysis.snapshot import HasState, snapshot
from warpgrains.base import checks
from warpgrains.base.arrays import FloatArray
from warpgrains.base.tables import library
from warpgrains.scene.snapshot import Snapshot

if TYPE_CHECKING:
    import xarray

ALONG = {"height": height_profile, "radius": radial_profile}
UNITS = {"packing_fraction": "", "velocity": "m/s", "spin": "rad/s", "temperature": "m2/s2", "stress": "N/m"}
WEIGHTED = {"velocity", "spin", "temperature"}
"""Fields whose means over time are weighted by the packing fraction: they are NaN in slices without
grains."""


class ProfileAverage(NamedTuple):
    """A profile averaged over time."""

    mean: Profile
    error: Profile
    """Standard errors of the means. Those of `edges` matter only if walls move."""


class ProfileSeries:
    """Profiles, measured during a run: ``simulation.run(observer=profiles)``.

    The slices of each profile divide the container at that time: if a wall moves, they move and stretch.

    Parameters
    ----------
    along : str
        "height" or "radius", see `height_profile` and `radial_profile`.
    every : int
        Steps between two profiles. Profiles are measured at multiples of this number.
    bins, region
        See `height_profile`.

    Attributes
    ----------
    time : list of float
        Times of the profiles [s].
    profiles : list of Profile
        The profiles.

    Raises
    ------
    InputError
        An argument is invalid.

    Examples
    --------
    >>> profiles = analysis.ProfileSeries("height", every=20, bins=4)
    >>> summary = wg.Simulation(simulation.scene).run(duration=2.0, observer=profiles)
    >>> profiles.average(after=1.0, blocks=5).mean.packing_fraction.round(2)
    array([0.09, 0.04, 0.03, 0.  ])
    """

    def __init__(self, along: str = "height", every: int = 10, *, bins: int = 20, region: Where = None):
        function = ALONG[checks.one_of("along", along, ALONG)]
        self._measure = partial(function, bins=checks.whole_number("bins", bins), region=region)
        self.every = checks.whole_number("every", every)
        self.time: list[float] = []
        self.profiles: list[Profile] = []

    def observe(self, simulation: Snapshot | HasState) -> None:
        """Measure and store a profile of the present state."""
        now = snapshot(simulation)
        self.profiles.append(self._measure(now))
        self.time.append(now.time)

    def flush(self) -> None:
        """Do nothing. A run calls it at checkpoints, because other observers write files then."""

    def _values(self, name: str, after: float = -np.inf) -> FloatArray:
        """Return field `name` of the profiles from time `after` [s] on, stacked along the first axis."""
        each = zip(self.time, self.profiles, strict=True)
        return np.array([getattr(profile, name) for time, profile in each if time >= after])

    def average(self, after: float = -np.inf, blocks: int = 10) -> ProfileAverage:
        """Return means over the profiles from a time on, and standard errors, see `Series.average`.

        Velocity, spin and temperature are weighted by the packing fraction of the slice.

        Parameters
        ----------
        after : float
            Time from which profiles count [s].
        blocks : int
            Number of blocks, at least 2.

        Raises
        ------
        InputError
            There are fewer profiles than blocks.
        """
        share, found = self._values("packing_fraction", after), []
        for name in Profile._fields:
            values = self._values(name, after)
            weight = share.reshape(*share.shape, *[1] * (values.ndim - 2)) if name in WEIGHTED else 1.0
            found.append(block_average(values, blocks, weight))
        return ProfileAverage(*(Profile(*part) for part in zip(*found, strict=True)))

    def to_xarray(self) -> xarray.Dataset:
        """Return the profiles as a dataset over time and slices, with units.

        Raises
        ------
        InputError
            xarray is not installed; the extra ``[data]`` installs it.
        """
        dims = "time", "slice", "component", "other"
        found = {}
        for name, unit in UNITS.items():
            values = self._values(name)
            found[name] = dims[: values.ndim], values, {"units": unit}
        edges = self._values("edges")
        for name, values in (("low", edges[:, :-1]), ("high", edges[:, 1:])):
            found[name] = dims[:2], values, {"units": "m"}
        return library("xarray", "to_xarray").Dataset(found, coords={"time": ("time", self.time)})
