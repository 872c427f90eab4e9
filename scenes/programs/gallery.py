"""The gallery: pictures of every shipped scene, of a jam and of a batch, with numbers.

python scenes/programs/gallery.py -o gallery [NAME ...]
"""

import itertools
from functools import partial
from math import cos, radians, sin

import bouncing
import closed_forms
import drum
import numpy as np
from collapse import front, top
from matplotlib.colors import LogNorm
from matplotlib.patches import Circle
from sections import Numbers, Row, Section, Sections, draw_sections, moments, panels

import warpgrains as wg
from warpgrains import analysis

COUNT = 1000  # scenes of the batch
BIN = 0.01  # side of the squares in which it counts centers [m]


def shipped(name: str, *times: float, color_by: str = "speed") -> Section:
    """Draw a shipped scene at some times [s]; return the figure and numbers.

    The numbers are the mean iterations of a step, the worst overlap, and the contacts per grain in the end.
    """
    scene = wg.Scene.load(name)
    figure, simulation, summary = moments(scene, times, color_by)
    return figure, {
        "iterations a step": summary.iterations_mean,
        "worst overlap [smallest radii]": summary.overlap / scene.smallest_radius,
        "contacts a grain": analysis.coordination_number(simulation),
    }


def column() -> Section:
    """Draw the forces in a column of grains over the number of the contact, at several times.

    Return the figure, and the difference of the last forces from the weights above the contacts.
    """
    scene = wg.Scene.load("column")
    simulation = wg.Simulation(scene)
    figure, axes = panels()
    for time in (0.02, 0.03, 0.04, 0.07, 1.0):  # after 0.1 s nothing changes
        simulation.run(duration=time - simulation.time)
        contacts = simulation.contacts()
        axes.plot(contacts.pair[:, 0] + 1, contacts.force, ".-", label=f"t = {simulation.time:g} s")
    above = scene.mass[0] * np.hypot(*scene.gravity) * (scene.n - 1 - contacts.pair[:, 0])
    axes.set(xlabel="contact, from the lowest", ylabel="force [N]", ylim=(0.0, 1.3 * above.max()))
    axes.legend()
    return figure, {
        "contacts between grains": len(contacts.force),
        "their weights above, at most [N]": float(above.max()),
        "worst difference of a force [N]": float(np.abs(contacts.force - above).max()),
    }


def bidisperse() -> Section:
    """Draw settled grains of two sizes, and equal ones for comparison.

    Return the figure, and the numbers of grains and contacts.
    """
    row, numbers = Row(2), {}
    for label, overrides in {"of two sizes": (), "equal": ("grains.radius=0.048",)}.items():
        simulation = wg.Simulation(wg.Scene.load("bidisperse", overrides))
        simulation.run()
        row.show(simulation, "pressure")
        numbers[f"grains, {label}"] = simulation.scene.n
        numbers[f"contacts, {label}"] = simulation.step().contacts
    return row.figure, numbers


def bullet() -> Section:
    """Draw a grain that is shot into a crystal of grains.

    Return the figure, its momentum, that of all grains in the end, and the worst overlap.
    """
    scene = wg.Scene.load("bullet")
    figure, simulation, summary = moments(scene, (0.004, 0.006, 0.03, 0.09))
    moved = (scene.mass[:, np.newaxis] * simulation.velocity).sum(axis=0)
    return figure, {
        "momentum of the bullet [kg m/s]": float(scene.mass[0] * scene.velocity[0, 0]),
        "momentum in the end [kg m/s]": float(moved[0]),
        "worst overlap [smallest radii]": summary.overlap / scene.smallest_radius,
    }


def slope() -> Section:
    """Draw a grain that rolls on a slope and one that slides on another.

    Return the figure, and their distances with the closed forms [m].
    """
    scene, time = wg.Scene.load("slope"), 0.6
    figure, simulation, _ = moments(scene, (0.2, 0.4, time), "spin")
    g, theta, friction = -scene.gravity[1], radians(30.0), scene.at_walls["friction"][1]
    rolls, slides = 2.0 / 3.0 * g * sin(theta), g * (sin(theta) - friction * cos(theta))
    ways = np.hypot(*(simulation.position - scene.position).T)
    return figure, {
        "way of the upper grain [m]": float(ways[0]),
        "2/3 g sin(30) t^2 / 2 [m]": 0.5 * rolls * time**2,
        "way of the lower grain [m]": float(ways[1]),
        "g (sin(30) - 0.1 cos(30)) t^2 / 2 [m]": 0.5 * slides * time**2,
    }


def balls() -> Section:
    """Draw balls with three restitutions that fall and bounce.

    Return the figure, and the height of each first bounce, divided by that of the fall.
    """
    scene = wg.Scene.load("bouncing")
    figure, _, _ = moments(scene, (0.45, 0.8, 1.2))
    simulation, heights = wg.Simulation(scene), []
    for _ in range(1600):
        simulation.step()
        heights.append(simulation.position[:, 1] + 0.5)
    fall, height = scene.position[0, 1] + 0.5, np.array(heights).T
    tops = [bouncing.tops(one)[0] / fall for one in height]
    restitutions = scene.at_walls["restitution"][:3].tolist()  # of the floors
    return figure, {
        f"e {e:g}: first bounce / fall": float(top) for e, top in zip(restitutions, tops, strict=True)
    }


def cradle() -> Section:
    """Draw Newton's cradle before, during and after the first pass of speed through its balls.

    Return the figure, the number of times that the fastest ball changes, and the final speed and energy.
    """
    scene = wg.Scene.load("cradle")
    figure, _, _ = moments(scene, (0.2, 0.44, 0.7))
    simulation, moving, passes = wg.Simulation(scene), 0, 0
    for _ in range(scene.steps):
        simulation.step()
        last, moving = moving, int(np.abs(simulation.velocity[:, 0]).argmax())
        passes += moving != last
    return figure, {
        "times that a speed is handed on": passes,
        "speed of the last one [m/s]": analysis.quantities(simulation, "largest_speed")["largest_speed"],
        "energy / that of the start": analysis.kinetic_energy(simulation) / (0.5 * scene.mass[0]),
    }


def gas() -> Section:
    """Draw the gas at the end, and the distribution of its velocities with that of Maxwell and Boltzmann."""
    scene, velocities = wg.Scene.load("gas"), []
    simulation = wg.Simulation(scene)
    for _ in range(100):
        simulation.advance(scene.steps // 100)
        velocities.append(simulation.velocity.ravel())
    v, energy = np.concatenate(velocities[20:]), [float((one**2).sum()) for one in velocities]
    figure, (places, speeds) = panels(1, 2, width_ratios=(1, 2))
    for x, y in scene.period.wrapped(simulation.position):
        for image in itertools.product(
            *((one - side, one, one + side) for one, side in zip((x, y), scene.period.lengths, strict=True))
        ):
            places.add_patch(Circle(image, scene.radius[0], color="C0", linewidth=0.0))
    places.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    at = np.linspace(-4.0, 4.0, 200)
    speeds.hist(v, bins=60, density=True, alpha=0.5)
    speeds.plot(at, np.exp(-(at**2) / (2.0 * v.var())) / np.sqrt(2.0 * np.pi * v.var()), "k:")
    speeds.set(xlabel="component of the velocity [m/s]", ylabel="[s/m]")
    return figure, {
        "energy / that of the start": energy[-1] / float((scene.velocity**2).sum()),
        "mean of v^4 / square of that of v^2": float((v**4).mean() / (v**2).mean() ** 2),
    }


def hopper() -> Section:
    """Draw the hopper, and count the grains that have left it."""
    simulation, row, numbers = wg.Simulation(wg.Scene.load("hopper")), Row(3), {}
    for time in (0.5, 1.0, 1.5, 2.0, 2.5):
        simulation.run(duration=time - simulation.time)
        below = simulation.position[:, 1] < -0.1
        numbers[f"grains that have left after {time} s"] = int(below.sum())
        if time in (0.5, 1.5, 2.5):
            row.show(simulation)
    return row.figure, numbers


def refilled(name: str, *times: float) -> Section:
    """Draw a shipped scene at some times [s], in which the source returns the grains that sinks remove.

    Return the figure, and the numbers of grains that have left through the sinks.
    """
    simulation, row = wg.Simulation(wg.Scene.load(name)), Row(len(times))
    numbers: Numbers = {"grains at the start": simulation.scene.n}
    for time in times:
        simulation.run(duration=time - simulation.time)
        row.show(simulation, range="0,3")
        numbers[f"grains that have left after {time} s"] = sum(own.grains for own in simulation.outflow)
    return row.figure, numbers | {
        "in the end, with those that wait": simulation.scene.n + simulation.inflow[0].waiting
    }


def collapse() -> Section:
    """Draw the column before and after the gate opens; return its heights and its run-out."""
    scene = wg.Scene.load("collapse")
    simulation, row, heights, width = wg.Simulation(scene), Row(4), [], 0.3
    for time in (0.5, 0.8, 1.1, scene.duration):
        simulation.run(duration=time - simulation.time)
        row.show(simulation)
        heights.append(top(simulation) + 0.3)
    return row.figure, {
        "height of the column over its width": heights[0] / width,
        "run-out over its width": (front(simulation) + 0.6) / width,
        "height that remains over its width": heights[-1] / width,
    }


def jamming() -> Section:
    """Draw grains before, during and after their compression.

    Return the figure, and numbers of the final packing, such as its fraction and its contacts per grain.
    """
    scene = wg.Scene.load("jamming")
    packing, simulation, row = wg.compress(scene), wg.Simulation(scene), Row(3)
    row.show(simulation, "pressure", largest=packing.largest_force)
    simulation.run(duration=1.6)
    row.show(simulation, "pressure", largest=packing.largest_force)
    row.show(packing.simulation, "pressure", largest=packing.largest_force)
    return row.figure, {
        "packing fraction": packing.fraction,
        "packing fraction away from the wall": packing.bulk_fraction,
        "contacts a grain": packing.contacts,
        "rattlers": packing.rattlers,
        "forces of the wall / (2 pi R p)": packing.pressure,
        "largest force / mean": packing.largest_force / packing.mean_force,
    }


def jam() -> Section:
    """Draw five grains that are wedged between walls whose distance is a little less than five diameters.

    Return the figure, and the number of steps without a solution and the growth of the force.
    """
    chain = np.column_stack([np.zeros(5), -0.55 - 0.1 * np.arange(5)])
    loose = np.column_stack([[-0.5, -0.35, 0.35, 0.5], [0.55, 0.75, 0.75, 0.55]])
    places, circles = np.vstack([chain, loose]), {"radius_in": 0.5, "radius_out": 1.0}
    scene = wg.Scene(position=places, radius=0.0502, mass=0.1, max_iterations=1000, **circles)
    simulation, row = wg.Simulation(scene), Row(2)
    force, states, unsolved = [], {}, 0
    for step in range(1, 17):
        simulation.step()
        named = simulation.infeasible_grains()
        unsolved += len(named) > 0
        force.append(float(simulation.contacts().force.max()))
        states[step] = simulation.state()
    for step in (1, 16):
        simulation.restore(states[step])
        row.show(simulation, "pressure", largest=force[-1])
    return row.figure, {
        "steps without a solution": unsolved,
        "grains that cannot fit": len(named),
        "force that a step adds [N]": force[-1] - force[-2],
    }


def batch() -> Section:
    """Run the course's scene from a thousand random velocities; draw where grains rest, and their forces."""
    scene, random = wg.Scene.load("annulus"), np.random.default_rng(0)
    scenes = [scene.replace(velocity=random.normal(0.0, 0.5, (scene.n, 2))) for _ in range(COUNT)]
    many = wg.Batch(scenes)
    many.run()
    ends = [analysis.snapshot(one, many.state(k)) for k, one in enumerate(scenes)]
    x, y = np.concatenate([end.position for end in ends]).T
    largest = np.array([end.force.max() for end in ends])
    figure, (places, forces) = panels(2, 1, height_ratios=(3, 2), height=6.4)
    limits = (-1.2, 1.2), (-2.02, -1.32)
    bins = [round((high - low) / BIN) for low, high in limits]
    shown = places.hist2d(x, y, bins=bins, range=limits, norm=LogNorm(), cmap="magma_r")[3]
    figure.colorbar(shown, ax=places, label="centers in a square of 1 cm")
    wall = {"color": "0.35", "linewidth": 1.5, "label": "outer wall"}
    reached = {"color": "0.6", "linestyle": ":", "label": "centers of grains that touch it"}
    for radius, look in ((scene.radius_out, wall), (scene.radius_out - scene.smallest_radius, reached)):
        places.add_patch(Circle((0.0, 0.0), radius, fill=False, **look))
    places.legend(loc="upper center", ncols=2)
    places.set(xlim=limits[0], ylim=limits[1], xlabel="x [m]", ylabel="y [m]", aspect="equal")
    forces.hist(largest, bins=40)
    forces.set(xlabel="largest force between two grains [N]", ylabel="scenes")
    return figure, {
        "scenes": len(scenes),
        "mean of the largest forces [N]": float(largest.mean()),
        "deviation [N]": float(largest.std()),
        "mean height of the centres [m]": float(y.mean()),
    }


SECTIONS: Sections = {
    "annulus": partial(shipped, "annulus", 0.2, 0.5, 1.0, 8.0),
    "column": column,
    "no_inner_wall": partial(shipped, "no_inner_wall", 0.1, 0.4, 0.8, 1.6),
    "polydisperse": partial(shipped, "polydisperse", 0.1, 0.3, 0.6, 3.0),
    "pile": partial(shipped, "pile", 0.2, 0.5, 0.8, 2.0),
    "bowl": closed_forms.bowl,
    "bullet": bullet,
    "bidisperse": bidisperse,
    "drum": drum.section,
    "heap": closed_forms.heap,
    "rotating_drum": partial(shipped, "rotating_drum", 1.0, 2.0, 4.0),
    "couette": partial(shipped, "couette", 0.5, 4.0, color_by="spin"),
    "slope": slope,
    "bouncing": balls,
    "cradle": cradle,
    "gas": gas,
    "hopper": hopper,
    "silo": partial(refilled, "silo", 1.0, 2.0, 3.0),
    "hourglass": partial(refilled, "hourglass", 2.0, 4.0, 6.0),
    "collapse": collapse,
    "box": partial(shipped, "box", 1.0, 1.75, 2.5),
    "shear": partial(shipped, "shear", 1.0, 2.0, 4.0),
    "jamming": jamming,
    "jam": jam,
    "batch": batch,
}
main = partial(draw_sections, SECTIONS, __doc__, "gallery")


if __name__ == "__main__":
    main()
