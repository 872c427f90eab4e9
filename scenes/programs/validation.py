"""Validation of friction, restitution and straight walls: closed forms and experiments, with numbers.

python scenes/programs/validation.py -o validation [NAME ...]
"""

from collections.abc import Sequence
from functools import partial

import bouncing
import closed_forms
import collapse
import numpy as np
import shear
import silos
import slopes
import steps
from sections import Numbers, Section, Sections, draw_sections, panels

import warpgrains as wg
from warpgrains import analysis
from warpgrains.analysis import Snapshot
from warpgrains.base.arrays import FloatArray
from warpgrains.scene.layouts import random_layout

FRICTIONS = (0.0, 0.1, 0.3, 0.5, 1.0)  # of the packings
SEEDS = (1, 2, 3)
REPOSE = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8)  # between grains in the rotating drum
EVERY, SETTLED = 0.1, 3.0  # between two slopes of a drum, and from which on they are averaged [s]
SWEPT = ["solver.method=accelerated"]  # which takes a third of the time
ROLLING = (0.0, 0.05, 0.1, 0.2, 0.3)  # rolling friction of drums and heaps


def loose(friction: float, seed: int) -> wg.Scene:
    """Return 600 grains of two sizes without gravity, in a box that is periodic in x.

    Its top is a lid that presses on the grains.
    """
    lid = wg.Box((0.0, 1.0), (0.0, 2.5), periodic="x", top={"pressure": 1.0, "mass": 10.0})
    radii = {"distribution": "values", "values": [0.02, 0.028]}
    position, radius = random_layout(lid.space, radius=radii, count=600, seed=seed)
    return wg.Scene(
        position=position,
        radius=radius,
        mass=10.0 * np.pi * radius**2,
        domain=lid,
        friction=friction,
        gravity=(0.0, 0.0),
        drag=0.05,
        spin_drag=1e-5 if friction else 0.0,
        dt=0.02,
        duration=50.0,
        tolerance=1e-5,
        max_iterations=500,
        method="accelerated",
        order="color",
    )


def packed(now: Snapshot) -> list[float]:
    """Return contacts per grain, packing fraction, sliding contacts per grain and the largest speed [m/s].

    The first two are those of the grains more than three mean diameters away from the top and the bottom.
    Contacts per grain are without rattlers.
    """
    bottom, top = now.container.region.outer_box[:, 1] + np.array([0.15, -0.15])
    bulk = {"y": (bottom, top)}
    force = np.concatenate([now.force, now.wall_force])
    tangential = np.abs(np.concatenate([now.tangential_force, now.wall_tangential_force]))
    return [
        analysis.coordination_number(now, without_rattlers=True, region=bulk),
        analysis.packing_fraction(now, bulk),
        np.count_nonzero(tangential >= (1.0 - 1e-12) * now.scene.friction * force) / now.n,
        float(np.hypot(*now.velocity.T).max()),
    ]


def packings() -> Section:
    """Compress grains with several coefficients of friction; draw contacts per grain and packing fraction.

    Return the figure, these numbers with errors, and the sliding contacts.
    """
    scenes = [loose(friction, seed) for friction in FRICTIONS for seed in SEEDS]
    batch = wg.Batch(scenes)
    batch.run()
    each = [packed(analysis.snapshot(scene, batch.state(k))) for k, scene in enumerate(scenes)]
    found = np.reshape(each, (len(FRICTIONS), len(SEEDS), -1))
    mean, error = found.mean(axis=1), found.std(axis=1, ddof=1) / np.sqrt(len(SEEDS))
    figure, axes = panels(1, 2)
    names = ("contacts a grain", "packing fraction", "sliding contacts a grain")
    numbers: Numbers = {}
    for k, (one, name) in enumerate(zip(axes, names, strict=False)):
        one.errorbar(FRICTIONS, mean[:, k], error[:, k], fmt="o-", capsize=3.0)
        one.set(xlabel="friction", ylabel=name)
    for isostatic in (3.0, 4.0):
        axes[0].axhline(isostatic, color="0.6", linestyle=":")
    for friction, own, off, speed in zip(FRICTIONS, mean, error, found[..., -1].max(axis=1), strict=True):
        numbers |= {f"mu {friction:g}: {name}": float(own[k]) for k, name in enumerate(names)}
        numbers |= {f"mu {friction:g}: error of the {names[k]}": float(off[k]) for k in (0, 1)}
        numbers[f"mu {friction:g}: largest speed [m/s]"] = float(speed)
    return figure, numbers


def surface_angle(now: Snapshot) -> float:
    """Return the slope of the surface of grains in a drum [degrees].

    It is that of a line fitted to the highest grains in slices of |x| < 0.6 m.
    """
    touching = analysis.contact_numbers(now) > 0
    x, top = now.position[touching, 0], now.position[touching, 1] + now.scene.radius[touching]
    highest = []
    for middle in np.arange(-0.55, 0.6, 0.1):
        inside = np.abs(x - middle) < 0.05
        if inside.any():
            highest.append((middle, top[inside].max()))
    return float(np.degrees(np.arctan(silos.straight_line(*np.transpose(highest))[1])))


def rotated(scenes: Sequence[wg.Scene]) -> tuple[FloatArray, FloatArray]:
    """Rotate drums for 8 s; return times [s], (m,), and slopes of their surfaces [degrees], (drums, m)."""
    batch, angles = wg.Batch(scenes), []
    time = np.arange(1, 81) * EVERY
    for _ in time:
        batch.run(duration=EVERY)
        angles.append(
            [surface_angle(analysis.snapshot(scene, batch.state(k))) for k, scene in enumerate(scenes)]
        )
    return time, np.transpose(angles)


def repose() -> Section:
    """Draw the slopes of the surfaces in rotating drums, over time and over friction.

    One drum rotates more slowly. Return the figure and the mean slopes [degrees].
    """
    scene = wg.Scene.load("rotating_drum", SWEPT)
    scenes = [scene.replace(friction=friction) for friction in REPOSE]
    scenes.append(scene.replace(angular_velocity_out=scene.angular_velocity_out / 3.0))
    time, slope = rotated(scenes)
    mean, deviation = slope[:, time > SETTLED].mean(axis=1), slope[:, time > SETTLED].std(axis=1)
    figure, (over_time, over_friction) = panels(1, 2)
    for friction, angle in zip(REPOSE, slope[:-1], strict=True):
        over_time.plot(time, angle, label=f"friction {friction:g}")
    over_time.set(xlabel="t [s]", ylabel="slope of the surface [degrees]")
    over_time.legend(fontsize="x-small", ncols=2)
    fast, slow = (f"{one.angular_velocity_out:g} rad/s" for one in (scene, scenes[-1]))
    over_friction.errorbar(REPOSE, mean[:-1], deviation[:-1], fmt="o-", capsize=3.0, label=fast)
    over_friction.errorbar(scene.friction, mean[-1], deviation[-1], fmt="s", capsize=3.0, label=slow)
    over_friction.set(xlabel="friction between grains", ylabel="slope of the surface [degrees]")
    over_friction.legend()
    numbers = {f"mu {mu:g}: slope [degrees]": float(one) for mu, one in zip(REPOSE, mean, strict=False)}
    return figure, numbers | {f"mu {scene.friction:g}, {slow}: slope [degrees]": float(mean[-1])}


def rolling() -> Section:
    """Draw results over rolling friction: accelerations on slopes, and slopes in drums and of heaps.

    The heaps are columns that have collapsed. Return the figure and these numbers.
    """
    figure, (slopes, angles) = panels(1, 2)
    tangents, worst = np.linspace(0.0, 2.0, 41), 0.0
    for mu in (0.0, 0.1, 0.3):
        found, exact = (
            [acceleration(tangent, 0.6, mu) for tangent in tangents]
            for acceleration in (closed_forms.measured_on_a_slope, closed_forms.acceleration_on_a_slope)
        )
        (line,) = slopes.plot(tangents, found, ".", label=f"rolling friction {mu:g}")
        slopes.plot(tangents, exact, color=line.get_color(), linewidth=0.8)
        worst = max(worst, float(np.abs(np.subtract(found, exact)).max()))
    slopes.set(xlabel="slope, tan(theta)", ylabel="acceleration [m/s2]")
    drum = wg.Scene.load("rotating_drum", [*SWEPT, "grains.count=300", "grains.radius=[0.032, 0.045]"])
    time, slope = rotated([drum.replace(rolling_friction=mu) for mu in ROLLING])
    mean = slope[:, time > SETTLED].mean(axis=1)
    piles = np.array(
        [[collapse.collapsed(1.0, seed, 300, rolling_friction=mu) for seed in SEEDS] for mu in ROLLING]
    )
    _, run_out, height = piles.transpose(2, 0, 1)
    heaps = np.degrees(np.arctan2(height, 1.0 + run_out)).mean(axis=1)
    for angle, label in ((mean, "drum"), (heaps, "heap: height / length")):
        angles.plot(ROLLING, angle, "o-", label=label)
    angles.set(xlabel="rolling friction", ylabel="slope [degrees]")
    for axes in (slopes, angles):
        axes.legend()
    numbers: Numbers = {"slope: worst error of the acceleration [m/s2]": worst}
    for mu, *found in zip(ROLLING, mean, heaps, run_out.mean(axis=1), strict=True):
        names = ("slope of the drum [degrees]", "slope of the heap [degrees]", "run-out / width")
        numbers |= {f"mu_r {mu:g}: {name}": float(one) for name, one in zip(names, found, strict=True)}
    return figure, numbers


def couette() -> Section:
    """Draw mean velocity and spin in the Couette cell over the distance from the inner wall, which rotates.

    Return the figure, the decay length of the velocity, and numbers of the first layers.
    """
    scene, bins, start, end = wg.Scene.load("couette", SWEPT), 24, 5.0, 15.0
    simulation = wg.Simulation(scene)
    simulation.run(duration=start)
    diameter = 2.0 * float(scene.radius.mean())
    edges = np.linspace(scene.radius_in, scene.radius_out, bins + 1)
    sums = np.zeros((4, bins))
    while simulation.time < end:
        simulation.advance(5)
        (x, y), (vx, vy) = simulation.position.T, simulation.velocity.T
        rho = np.hypot(x, y)
        of = np.digitize(rho, edges) - 1
        values = np.ones(scene.n), rho, (x * vy - y * vx) / rho, simulation.spin
        sums += [np.bincount(of, value, bins) for value in values]
    count, rho, along, spin = sums
    seen = count > 0
    rho, along, spin = (one[seen] / count[seen] for one in (rho, along, spin))
    wall = scene.radius_in * scene.angular_velocity_in
    away = (rho - scene.radius_in) / diameter
    half_vorticity = 0.5 * np.gradient(rho * along, rho) / rho
    fitted = (away > 1.0) & (away < 5.0)
    decay = np.polynomial.Polynomial.fit(away[fitted], np.log(along[fitted]), 1)
    length = -1.0 / float(decay.convert().coef[1])
    figure, (velocity, rotation) = panels(1, 2)
    velocity.semilogy(away, along / wall, "o", label="grains")
    fit = np.exp(decay(away[fitted])) / wall
    velocity.semilogy(away[fitted], fit, "k:", label=f"exp(-x / {length:.2f})")
    velocity.set(xlabel="distance from the wall [diameters]", ylabel="velocity / that of the wall")
    rotation.plot(away, spin, "o", label="spin")
    rotation.plot(away, half_vorticity, "k:", label="half the vorticity")
    rotation.set(xlabel="distance from the wall [diameters]", ylabel="[rad/s]")
    for axes in (velocity, rotation):
        axes.legend()
    return figure, {
        "grains": scene.n,
        "velocity of the first layer / wall": float(along[0] / wall),
        "decay length [diameters]": length,
        "spin of the first layer [rad/s]": float(spin[0]),
        "spin of the second layer [rad/s]": float(spin[away > 1.0][0]),
    }


SECTIONS: Sections = {
    "closed_forms": closed_forms.one_disc,
    "bouncing": bouncing.section,
    "packings": packings,
    "repose": repose,
    "rolling": rolling,
    "couette": couette,
    "solutions": steps.solutions,
    "hard_steps": steps.hard_steps,
    "exact_step": steps.exact_step,
    "slope": slopes.slope,
    "hopper": silos.hopper,
    "collapse": collapse.collapse,
    "piston": silos.piston,
    "shear": shear.shear,
    "chute": shear.chute,
}
main = partial(draw_sections, SECTIONS, __doc__, "validation")


if __name__ == "__main__":
    main()
