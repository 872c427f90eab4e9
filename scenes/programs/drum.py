"""A worked example: grains settle in a drum, at several drags; forces, pressures and packing fractions."""

from collections.abc import Sequence

import numpy as np
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from sections import Numbers, Section, panels

import warpgrains as wg
from warpgrains import analysis
from warpgrains.drawing.colorings import COLORINGS

DRAGS = (0.05, 0.1, 0.2, 0.4)  # kg/s


def settle(drag: float) -> wg.Simulation:
    """Return the drum at rest, simulated with a drag [kg/s]."""
    simulation = wg.Simulation(wg.Scene.load("drum", [f"physics.drag={drag}"]))
    simulation.run(until="rest,speed=2e-3,time=0.2")
    return simulation


def measure(simulation: wg.Simulation) -> Numbers:
    """Return the time to rest, and packing and forces of a drum at rest, by name with unit."""
    stress = analysis.mean_stress(simulation)
    force = analysis.force_statistics(simulation)
    return {
        "time to rest [s]": simulation.time,
        "packing fraction": analysis.pile_packing_fraction(simulation),
        "coordination": analysis.coordination_number(simulation, without_rattlers=True),
        "pressure [N/m]": float(np.trace(stress)) / 2.0,
        "stress yy / xx": float(stress[1, 1] / stress[0, 0]),
        "mean force [N]": force.mean,
        "deviation / mean": force.deviation / force.mean,
    }


def draw(settled: Sequence[wg.Simulation]) -> Figure:
    """Draw the pressure in the first drum, and for all the distribution of forces and packing over height."""
    figure, (drum, forces, heights) = panels(1, 3)
    first = settled[0]
    size = 2.0 * first.scene.radius
    place = {"units": "xy", "offsets": first.position, "offset_transform": drum.transData}
    color = COLORINGS["pressure"].colormap
    grains = EllipseCollection(size, size, 0.0 * size, cmap=color, **place)
    grains.set_array(np.trace(analysis.grain_stresses(first), axis1=1, axis2=2) / 2.0)
    drum.add_collection(grains)
    drum.add_patch(Circle((0.0, 0.0), first.scene.radius_out, fill=False, color="0.35", linewidth=2.0))
    drum.set(xlim=(-1.02, 1.02), ylim=(-1.02, 1.02), aspect="equal")
    drum.set_axis_off()
    figure.colorbar(grains, ax=drum, label="pressure [N/m]")
    for simulation in settled:
        edges, density = analysis.force_distribution(simulation, bins=14, most=4.0)
        label = f"drag {simulation.scene.drag:g} kg/s"
        forces.stairs(density, edges, label=label)
        profile = analysis.height_profile(simulation, bins=16)
        heights.stairs(profile.packing_fraction, profile.edges, label=label)
    forces.set(xlabel="f / mean f", ylabel="probability density", yscale="log")
    heights.set(xlabel="height above the center [m]", ylabel="packing fraction")
    forces.legend()
    return figure


def section() -> Section:
    """Let the drum settle at each drag; draw and return the results."""
    settled = [settle(drag) for drag in DRAGS]
    numbers = {
        f"drag {simulation.scene.drag:g} kg/s: {name}": value
        for simulation in settled
        for name, value in measure(simulation).items()
    }
    return draw(settled), numbers
