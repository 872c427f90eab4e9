"""A worked example: grains settle in a drum, at several drags; what carries them, in a table and a figure.

python -m warpgrains.scenes.drum -o drum.png
"""

import argparse
from collections.abc import Sequence
from typing import Any

import numpy as np

import warpgrains as wg
from warpgrains import analysis
from warpgrains.drawing.colors import QUANTITIES
from warpgrains.scenes.style import STYLE, panels

DRAGS = (0.05, 0.1, 0.2, 0.4)
"""kg/s."""


def settle(drag: float) -> wg.Simulation:
    """Return the drum at rest."""
    simulation = wg.Simulation(wg.Scene.load("drum", [f"physics.drag={drag}"]))
    simulation.run(until="rest,speed=2e-3,time=0.2")
    return simulation


def measure(simulation: wg.Simulation) -> dict[str, float]:
    """Return what a row of the table holds."""
    stress = analysis.mean_stress(simulation)
    force = analysis.force_statistics(simulation)
    return {
        "drag [kg/s]": simulation.scene.drag,
        "time to rest [s]": simulation.time,
        "packing fraction": analysis.packing_fraction(simulation),
        "coordination": analysis.coordination_number(simulation, without_rattlers=True),
        "pressure [N/m]": float(np.trace(stress)) / 2.0,
        "stress yy / xx": float(stress[1, 1] / stress[0, 0]),
        "mean force [N]": force.mean,
        "deviation / mean": force.deviation / force.mean,
    }


def draw(settled: Sequence[wg.Simulation], path: str) -> None:
    """Draw the pressure in the first drum, force distributions, packing by height, and time to rest."""
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Circle

    figure, (drum, forces, heights) = panels(1, 3)
    first = settled[0]
    pressure = np.trace(analysis.grain_stresses(first), axis1=1, axis2=2) / 2.0
    size = 2.0 * first.scene.radius
    grains = EllipseCollection(
        size,
        size,
        0.0 * size,
        units="xy",
        offsets=first.position,
        offset_transform=drum.transData,
        cmap=QUANTITIES["pressure"].colormap,
    )
    grains.set_array(pressure)
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
    figure.savefig(path)


def main(arguments: Sequence[str] | None = None) -> list[dict[str, Any]]:
    """Settle, print the table, and draw."""
    from matplotlib import rc_context

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", metavar="PNG", default="drum.png")
    output = parser.parse_args(arguments).output
    settled = [settle(drag) for drag in DRAGS]
    table = [measure(simulation) for simulation in settled]
    print("  ".join(table[0]))
    for row in table:
        print("  ".join(f"{value:{len(name)}.4g}" for name, value in row.items()))
    with rc_context(STYLE):
        draw(settled, output)
    return table


if __name__ == "__main__":
    main()
