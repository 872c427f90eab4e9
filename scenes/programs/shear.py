"""Flows in periodic boxes next to the literature: plane shear between rough walls, and a chute.

A mean disc is 1 m wide and has a mass of 1 kg.
"""

from math import cos, radians, sin, sqrt
from typing import Any

import numpy as np
from sections import Numbers, Section, panels

import warpgrains as wg
from warpgrains import analysis
from warpgrains.analysis import Snapshot
from warpgrains.base.arrays import FloatArray

STEP = 1.25  # of the lattice of the start [m]
COLUMNS, ROWS = 16, 18
WIDTH = COLUMNS * STEP
FRICTION = 0.4
ROUGH: dict[str, Any] = {"roughness": {"radius": 0.5, "spacing": 1.0}}
NUMBERS = (0.003, 0.01, 0.03, 0.1, 0.2, 0.3)  # inertial numbers, about
SEEDS = (1, 2, 3)
BEGIN, END = 3.0, 8.0  # strains between which flows are measured
SAMPLES = 400
ANGLES = (12.0, 20.0, 28.0)  # of the chute [degrees]: too flat, steady, and too steep
STEADY = (70.0, 130.0)  # s, between which its profiles are taken


def box_of_discs(seed: int, rate: float = 0.0, **fields: Any) -> wg.Scene:
    """Return discs of random sizes on a lattice in a box that is periodic in x.

    Their velocities are those of a shear at a rate [1/s]. `fields` are further fields of the scene, and the
    sides "bottom" and "top" of the box.
    """
    column, row = np.meshgrid(np.arange(COLUMNS), np.arange(1, ROWS + 1))
    position = STEP * np.stack([column + 0.5 * (row % 2), row], axis=-1).reshape(-1, 2)
    radius = np.random.default_rng(seed).uniform(0.4, 0.6, len(position))
    velocity = np.stack([rate * position[:, 1], np.zeros(len(position))], axis=1)
    sides = {name: fields.pop(name) for name in ("bottom", "top") if name in fields}
    domain = wg.Box((0.0, WIDTH), (0.0, STEP * (ROWS + 1)), periodic="x", **sides)
    common = {"friction": FRICTION, "stop": "residual", "max_iterations": 1000, "method": "accelerated"}
    grains = {"position": position, "velocity": velocity, "radius": radius, "mass": 4.0 * radius**2}
    return wg.Scene(domain=domain, **grains, **common | fields)


def sheared(number: float, seed: int) -> wg.Scene:
    """Return discs between rough walls, of which the upper one moves and presses with 1 N/m.

    Its speed is such that the inertial number becomes about `number`.
    """
    speed = number * 0.85 * ROWS
    lid = {"velocity": (speed, 0.0), "pressure": 1.0, "mass": float(COLUMNS), **ROUGH}
    return box_of_discs(
        seed,
        speed / (STEP * ROWS),
        bottom=ROUGH,
        top=lid,
        gravity=(0.0, 0.0),
        dt=min(0.1, 0.005 / number),
        tolerance=1e-4,
    )


def stresses(now: Snapshot) -> tuple[float, float]:
    """Return the shear stress and the pressure on the walls [N/m], means over upper and lower wall."""
    normal = now.wall_normal
    tangent = np.stack([-normal[:, 1], normal[:, 0]], axis=1)
    force = now.wall_force[:, np.newaxis] * normal + now.wall_tangential_force[:, np.newaxis] * tangent
    outwards = np.sign(normal[:, 1])
    return -float(outwards @ force[:, 0]) / (2.0 * WIDTH), float(outwards @ force[:, 1]) / (2.0 * WIDTH)


def middle_of(now: Snapshot) -> tuple[float, float]:
    """Return the shear rate [1/s] and the packing fraction in the middle half of the height."""
    (y, vx), height = (now.position[:, 1], now.velocity[:, 0]), now.position[:, 1].max()
    inside = np.abs(y - 0.5 * height) < 0.25 * height
    area = np.pi * (now.scene.radius[inside] ** 2).sum()
    return float(np.polyfit(y[inside], vx[inside], 1)[0]), float(area / (0.5 * height * WIDTH))


def measured(number: float) -> FloatArray:
    """Simulate shear flows at about the inertial number `number`, one for each seed.

    Returns, for each, shear stress divided by pressure, measured inertial number, and packing fraction, shape
    (seeds, 3).
    """
    scenes = [sheared(number, seed) for seed in SEEDS]
    batch, found = wg.Batch(scenes), []
    batch.run(duration=BEGIN / number)
    for _ in range(SAMPLES):
        batch.run(duration=(END - BEGIN) / number / SAMPLES)
        now = [analysis.snapshot(scene, batch.state(k)) for k, scene in enumerate(scenes)]
        found.append([(*stresses(one), *middle_of(one)) for one in now])
    shear, pressure, rate, fraction = np.moveaxis(np.mean(found, axis=0), -1, 0)
    return np.stack([shear / pressure, rate / np.sqrt(pressure), fraction], axis=1)


def shear() -> Section:
    """Draw effective friction and packing fraction of shear flows over the inertial number.

    Return the figure, these numbers, and the fitted lines.
    """
    found = np.array([measured(number) for number in NUMBERS])
    friction, number, fraction = found.mean(axis=1).T
    errors = found.std(axis=1, ddof=1).T / sqrt(len(SEEDS))
    numbers: Numbers = {}
    figure, axes = panels(1, 2)
    for one, values, error, name in zip(
        axes,
        (friction, fraction),
        (errors[0], errors[2]),
        ("effective friction", "packing fraction"),
        strict=True,
    ):
        slope, start = np.polyfit(number, values, 1)
        numbers |= {f"{name} at rest": float(start), f"its slope over I: {name}": float(slope)}
        one.errorbar(number, values, error, errors[1], fmt="o", capsize=3.0, label="mean of three seeds")
        one.plot(number, start + slope * number, "k:", label=f"{start:.3f} {slope:+.2f} I")
        one.set(xlabel="inertial number I", ylabel=name)
        one.legend()
    for values, error in zip(found.mean(axis=1), errors.T, strict=True):
        numbers[f"I {values[1]:.4f}: effective friction"] = float(values[0])
        numbers[f"I {values[1]:.4f}: its error"] = float(error[0])
        numbers[f"I {values[1]:.4f}: packing fraction"] = float(values[2])
    return figure, numbers


def pressures(now: Snapshot, planes: FloatArray) -> FloatArray:
    """Return the normal stress on horizontal planes at heights [m], shape (k,) [N/m].

    It is the sum of the contact forces across a plane, and of the momentum that moving grains carry through
    it.
    """
    (i, j), (nx, ny) = now.pair.T, now.normal.T
    y, force = now.position[:, 1], now.force * ny + now.tangential_force * nx
    crosses = (y[i] < planes[:, np.newaxis]) != (y[j] < planes[:, np.newaxis])
    near = np.abs(y - planes[:, np.newaxis]) < 0.5
    moving = near @ (now.scene.mass * now.velocity[:, 1] ** 2)
    return np.asarray((crosses @ (force * np.sign(y[j] - y[i])) + moving) / WIDTH)


def chute() -> Section:
    """Let discs flow down a rough bottom at several angles.

    Draw their mean velocity over time, and for one angle velocity and pressure over height. Return the
    figure, and the differences from Bagnold's profile and from a linear pressure.
    """
    scenes = []
    for angle in ANGLES:
        gravity = sin(radians(angle)), -cos(radians(angle))
        scenes.append(
            box_of_discs(1, 0.15, bottom=ROUGH, gravity=gravity, dt=0.01, tolerance=1e-4, max_iterations=200)
        )
    batch, every, planes = wg.Batch(scenes), 0.1, np.arange(3.0, 12.0)
    speeds, sums, times = [], np.zeros((3, len(planes))), np.arange(every, STEADY[1] + every / 2, every)
    for time in times:
        batch.run(duration=every)
        speeds.append([float(batch.velocity(k)[:, 0].mean()) for k in range(len(scenes))])
        if time > STEADY[0]:
            now = analysis.snapshot(scenes[1], batch.state(1))
            near = np.abs(now.position[:, 1] - planes[:, np.newaxis]) < 0.5
            sums += near.sum(axis=1), near @ now.velocity[:, 0], pressures(now, planes)
    speed, pressure = sums[1] / sums[0], sums[2] / np.count_nonzero(times > STEADY[0])
    slope, start = np.polyfit(planes, pressure, 1)
    height = -start / slope
    law = height**1.5 - (height - planes) ** 1.5
    factor, slip = np.polyfit(law, speed, 1)
    figure, (over_time, profile, stress) = panels(1, 3)
    over_time.plot(times, speeds, label=[f"{angle:g} degrees" for angle in ANGLES])
    over_time.set(xlabel="t [s]", ylabel="mean velocity [m/s]")
    profile.plot(speed, planes, "o", label="discs")
    profile.plot(slip + factor * law, planes, "k:", label="Bagnold")
    profile.set(xlabel="velocity [m/s]", ylabel="height [m]")
    stress.plot(pressure, planes, "o", label="discs")
    stress.plot(start + slope * planes, planes, "k:", label="linear")
    stress.set(xlabel="pressure [N/m]", ylabel="height [m]")
    for axes in (over_time, profile, stress):
        axes.legend()
    late = times > 0.75 * STEADY[1]
    final = np.transpose(speeds)
    return figure, {
        **{
            f"{angle:g} degrees: final velocity [m/s]": own[-1]
            for angle, own in zip(ANGLES, final, strict=True)
        },
        f"{ANGLES[1]:g} degrees: change in the last quarter, a part": float(
            np.polyfit(times[late], final[1][late], 1)[0] * 0.25 * STEADY[1] / final[1][late].mean()
        ),
        "height [m]": float(height),
        "largest deviation from Bagnold / surface velocity": float(
            np.abs(speed - slip - factor * law).max() / speed.max()
        ),
        "largest deviation from linear / largest pressure": float(
            np.abs(pressure - start - slope * planes).max() / pressure.max()
        ),
    }
