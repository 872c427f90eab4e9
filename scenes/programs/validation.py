"""Validation of friction, restitution and straight walls: closed forms and experiments, with numbers.

python scenes/programs/validation.py -o validation [NAME ...]
"""

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

FRICTIONS = (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0)  # of the packings
REPOSE = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8)  # between grains in the rotating drum


def settling(friction: float) -> wg.Scene:
    """Return 400 grains of two sizes that fall into a drum, with drag on velocities and spins."""
    radius = "grains.radius={distribution = 'values', values = [0.03, 0.042]}"
    scene = wg.Scene.load("bidisperse", ["grains.count=400", radius])
    spin_drag = 2e-4 if friction else 0.0
    return scene.replace(
        friction=friction, spin_drag=spin_drag, duration=4.0, tolerance=1e-5, max_iterations=1000
    )


def packed(now: Snapshot) -> Numbers:
    """Return the packing fraction of the bulk of a pile, and its contacts.

    The force of a contact has two unknown components, or one where it slides. A grain has three equations of
    balance, or two where nothing turns it.
    """
    scene, far = now.scene, 6.0 * now.scene.radius.max()
    bulk = (np.hypot(*now.position.T) < scene.radius_out - far) & (now.position[:, 1] < 0.0)
    filled = np.pi * (scene.radius[bulk] ** 2).sum() / analysis.cell_areas(now)[bulk].sum()
    bound = np.concatenate([scene.friction * now.force, scene.wall_frictions[0] * now.wall_force])
    tangential = np.concatenate([now.tangential_force, now.wall_tangential_force])
    slides = np.abs(tangential) >= (1.0 - 1e-12) * bound
    held = now.n - np.count_nonzero(analysis.rattlers(now))
    unknowns, equations = 2 * len(slides) - np.count_nonzero(slides), 3 if scene.has_friction else 2
    return {
        "packing fraction": float(filled),
        "contacts a grain": analysis.coordination_number(now, without_rattlers=True),
        "sliding contacts a grain": float(np.count_nonzero(slides) / held),
        "unknown forces beyond balance, a grain": float(unknowns / held - equations),
        "largest speed [m/s]": analysis.largest_speed(now),
    }


def packings() -> Section:
    """Settle piles of several frictions, and draw contact number and packing fraction."""
    scenes = [settling(friction) for friction in FRICTIONS]
    batch = wg.Batch(scenes)
    batch.run()
    found = [packed(analysis.snapshot(scene, batch.state(k))) for k, scene in enumerate(scenes)]
    figure, (contacts, packing) = panels(1, 2)
    contacts.plot(FRICTIONS, [one["contacts a grain"] for one in found], "o-")
    for isostatic in (3.0, 4.0):
        contacts.axhline(isostatic, color="0.6", linestyle=":")
    contacts.set(xlabel="friction", ylabel="contacts a grain")
    packing.plot(FRICTIONS, [one["packing fraction"] for one in found], "o-")
    packing.set(xlabel="friction", ylabel="packing fraction of the bulk")
    return figure, {
        f"mu {friction:g}: {name}": value
        for friction, one in zip(FRICTIONS, found, strict=True)
        for name, value in one.items()
    }


def surface_angle(now: Snapshot) -> float:
    """Return the slope of a surface [degrees]: a line through the highest grains over |x| < 0.6 m."""
    touching = analysis.contact_numbers(now) > 0
    x, top = now.position[touching, 0], now.position[touching, 1] + now.scene.radius[touching]
    highest = []
    for middle in np.arange(-0.55, 0.6, 0.1):
        inside = np.abs(x - middle) < 0.05
        if inside.any():
            highest.append((middle, top[inside].max()))
    return float(np.degrees(np.arctan(silos.straight_line(*np.transpose(highest))[1])))


def repose() -> Section:
    """Rotate drums of several frictions, and one slowly, and draw the slopes of their surfaces."""
    scene, every, settled = wg.Scene.load("rotating_drum"), 0.1, 3.0
    scenes = [scene.replace(friction=friction) for friction in REPOSE]
    scenes.append(scene.replace(angular_velocity_out=scene.angular_velocity_out / 3.0))
    batch, angles = wg.Batch(scenes), []
    time = np.arange(1, 81) * every
    for _ in time:
        batch.run(duration=every)
        angles.append(
            [surface_angle(analysis.snapshot(scene, batch.state(k))) for k, scene in enumerate(scenes)]
        )
    slope = np.transpose(angles)
    mean, deviation = slope[:, time > settled].mean(axis=1), slope[:, time > settled].std(axis=1)
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


def couette() -> Section:
    """Shear the Couette cell, and draw its mean velocity and spin over the distance from the inner wall."""
    scene, bins, start, end = wg.Scene.load("couette"), 24, 5.0, 15.0
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
