"""The gallery: a picture of every shipped scene, of a jam and of a batch, with the numbers that they show.

python -m warpgrains.scenes.gallery -o gallery [NAME ...]
"""

from functools import partial
from pathlib import Path

import numpy as np

import warpgrains as wg
from warpgrains import analysis
from warpgrains.scenes import bowl, closed_forms, drum, straight_walls
from warpgrains.scenes.exhibits import Exhibits, Numbers, Row, draw_exhibits, moments
from warpgrains.scenes.style import panels

COUNT = 1000
"""Scenes of the batch."""
BIN = 0.01
"""Side of the squares in which it counts centers [m]."""


def shipped(name: str, *times: float, path: Path, color_by: str = "speed") -> Numbers:
    """Draw a shipped scene, and print a summary of its solution."""
    scene = wg.Scene.load(name)
    simulation, summary = moments(path, scene, times, color_by)
    return {
        "iterations a step": summary.iterations_mean,
        "worst overlap [smallest radii]": summary.overlap / scene.smallest_radius,
        "contacts a grain": analysis.coordination_number(simulation),
    }


def column(path: Path) -> Numbers:
    """Draw the forces of the column over height, and hold the last ones against the weight above them."""
    scene = wg.Scene.load("column")
    simulation = wg.Simulation(scene)
    figure, axes = panels()
    for time in (0.02, 0.03, 0.04, 0.07, 1.0):  # after 0.1 s nothing changes
        simulation.run(duration=time - simulation.time)
        contacts = simulation.contacts()
        axes.plot(contacts.pair[:, 0] + 1, contacts.force, ".-", label=f"t = {simulation.time:g} s")
    weight = scene.mass[0] * np.hypot(*scene.gravity)
    above = weight * (scene.n - 1 - contacts.pair[:, 0])
    axes.set(xlabel="contact, from the lowest", ylabel="force [N]", ylim=(0.0, 1.3 * above.max()))
    axes.legend()
    figure.savefig(path)
    return {
        "contacts between grains": len(contacts.force),
        "their weights above, at most [N]": float(above.max()),
        "worst difference of a force [N]": float(np.abs(contacts.force - above).max()),
    }


def drums(path: Path) -> Numbers:
    """Draw the drum as drum.py does, and print the results at the least drag."""
    settled = [drum.settle(drag) for drag in drum.DRAGS]
    drum.draw(settled, str(path))
    return drum.measure(settled[0])


def bidisperse(path: Path) -> Numbers:
    """Let grains of two sizes settle, and equal ones for comparison."""
    row, numbers = Row(path, 2), {}
    for label, overrides in {"of two sizes": (), "equal": ("grains.radius=0.048",)}.items():
        simulation = wg.Simulation(wg.Scene.load("bidisperse", overrides))
        simulation.run()
        row.show(simulation, "pressure")
        report = simulation.step()
        numbers[f"grains, {label}"] = simulation.scene.n
        numbers[f"contacts, {label}"] = report.contacts
    return numbers


def bullet(path: Path) -> Numbers:
    """Shoot a grain into a crystal, and hold the momentum against that of the bullet."""
    scene = wg.Scene.load("bullet")
    simulation, summary = moments(path, scene, (0.004, 0.006, 0.03, 0.09))
    moved = (scene.mass[:, np.newaxis] * simulation.velocity).sum(axis=0)
    return {
        "momentum of the bullet [kg m/s]": float(scene.mass[0] * scene.velocity[0, 0]),
        "momentum in the end [kg m/s]": float(moved[0]),
        "worst overlap [smallest radii]": summary.overlap / scene.smallest_radius,
    }


def jamming(path: Path) -> Numbers:
    """Draw grains before, during and after their compression, and print what the packing is like."""
    scene = wg.Scene.load("jamming")
    packing, simulation, row = wg.compress(scene), wg.Simulation(scene), Row(path, 3)
    row.show(simulation, "pressure", packing.largest_force)
    simulation.run(duration=1.6)
    row.show(simulation, "pressure", packing.largest_force)
    row.show(packing.simulation, "pressure", packing.largest_force)
    return {
        "packing fraction": packing.fraction,
        "packing fraction away from the wall": packing.bulk_fraction,
        "contacts a grain": packing.contacts,
        "rattlers": packing.rattlers,
        "forces of the wall / (2 pi R p)": packing.pressure,
        "largest force / mean": packing.largest_force / packing.mean_force,
    }


def jam(path: Path) -> Numbers:
    """Wedge five grains between the walls, where there is room for a little less than five."""
    y = -0.55 - 0.1 * np.arange(5)
    chain = np.column_stack([np.zeros(5), y])
    loose = np.column_stack([[-0.5, -0.35, 0.35, 0.5], [0.55, 0.75, 0.75, 0.55]])
    scene = wg.Scene(
        position=np.vstack([chain, loose]), radius=0.0502, mass=0.1, radius_in=0.5, radius_out=1.0
    ).replace(max_iterations=1000)
    simulation, row = wg.Simulation(scene), Row(path, 2)
    force, moments, unsolved = [], {}, 0
    for step in range(1, 17):
        named = simulation.step().infeasible
        unsolved += len(named) > 0
        force.append(float(simulation.contacts().force.max()))
        moments[step] = simulation.state()
    for step in (1, 16):
        simulation.restore(moments[step])
        row.show(simulation, "pressure", largest=force[-1])
    return {
        "steps without a solution": unsolved,
        "grains that cannot fit": len(named),
        "force that a step adds [N]": force[-1] - force[-2],
    }


def batch(path: Path) -> Numbers:
    """Kick the grains of the course's scene at random, a thousand times, and see where they come to rest."""
    from matplotlib.colors import LogNorm
    from matplotlib.patches import Circle

    scene, random = wg.Scene.load("annulus"), np.random.default_rng(0)
    scenes = [scene.replace(velocity=random.normal(0.0, 0.5, (scene.n, 2))) for _ in range(COUNT)]
    many = wg.Batch(scenes)
    many.run()
    ends = [analysis.snapshot(one, many.state(k)) for k, one in enumerate(scenes)]
    x, y = np.concatenate([end.position for end in ends]).T
    largest = np.array([end.force.max() for end in ends])
    figure, (places, forces) = panels(2, 1, height_ratios=(3, 2), height=6.4)
    left, right, low, high = -1.2, 1.2, -2.02, -1.32
    bins = (round((right - left) / BIN), round((high - low) / BIN))
    limits = (left, right), (low, high)
    shown = places.hist2d(x, y, bins=bins, range=limits, norm=LogNorm(), cmap="magma_r")[3]
    figure.colorbar(shown, ax=places, label="centers in a square of 1 cm")
    wall = Circle((0.0, 0.0), scene.radius_out, fill=False, color="0.35", linewidth=1.5)
    reached = Circle(
        (0.0, 0.0), scene.radius_out - scene.smallest_radius, fill=False, color="0.6", linestyle=":"
    )
    for circle, label in ((wall, "outer wall"), (reached, "centers of grains that touch it")):
        circle.set_label(label)
        places.add_patch(circle)
    places.legend(handles=[wall, reached], loc="upper center", ncols=2)
    places.set(xlim=(left, right), ylim=(low, high), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    forces.hist(largest, bins=40)
    forces.set(xlabel="largest force between two grains [N]", ylabel="scenes")
    figure.savefig(path)
    return {
        "scenes": len(scenes),
        "mean of the largest forces [N]": float(largest.mean()),
        "deviation [N]": float(largest.std()),
        "mean height of the centres [m]": float(y.mean()),
    }


EXHIBITS: Exhibits = {
    "annulus": lambda path: shipped("annulus", 0.2, 0.5, 1.0, 8.0, path=path),
    "column": column,
    "no_inner_wall": lambda path: shipped("no_inner_wall", 0.1, 0.4, 0.8, 1.6, path=path),
    "polydisperse": lambda path: shipped("polydisperse", 0.1, 0.3, 0.6, 3.0, path=path),
    "pile": lambda path: shipped("pile", 0.2, 0.5, 0.8, 2.0, path=path),
    "bowl": bowl.draw,
    "bullet": bullet,
    "bidisperse": bidisperse,
    "drum": drums,
    "heap": closed_forms.draw_heap,
    "rotating_drum": lambda path: shipped("rotating_drum", 1.0, 2.0, 4.0, path=path),
    "couette": lambda path: shipped("couette", 0.5, 4.0, path=path, color_by="spin"),
    "slope": straight_walls.draw_slope,
    "hopper": straight_walls.draw_hopper,
    "collapse": straight_walls.draw_collapse,
    "jamming": jamming,
    "jam": jam,
    "batch": batch,
}
main = partial(draw_exhibits, EXHIBITS, __doc__, "gallery")


if __name__ == "__main__":
    main()
