"""One grain slides in a bowl: a pendulum, and so a closed form for the order in dt of both schemes."""

from pathlib import Path

import numpy as np

import warpgrains as wg
from warpgrains.arrays import FloatArray
from warpgrains.scenes.style import panels

FIRST_ORDER = {"scheme": "text", "wall": "tangent"}
SECOND_ORDER = {"scheme": "leapfrog", "wall": "round"}


def draw(path: Path) -> dict[str, float]:
    """Draw the slides of both schemes, next to the pendulum, and return their orders in dt."""
    scene = wg.Scene.load("bowl")
    steps = scene.dt * 2.0 ** -np.arange(-3, 4)
    figure, (swings, errors) = panels(1, 2)
    numbers = {}
    for label, changes in {"text, tangent": FIRST_ORDER, "leapfrog, round wall": SECOND_ORDER}.items():
        worst = []
        for dt in steps:
            time, angle = swing(scene.replace(dt=dt, **changes))
            worst.append(float(np.abs(angle - pendulum(scene, time)).max()))
            if dt == steps[0]:
                swings.plot(time, np.degrees(angle), label=label)
        errors.loglog(steps, worst, "o-", label=label)
        numbers[f"order, {label}"] = float(np.log2(worst[-2] / worst[-1]))
    swings.plot(time, np.degrees(pendulum(scene, time)), "k:", label="pendulum")
    swings.set(xlabel="t [s]", ylabel="angle [degrees]", title=f"dt {steps[0]:g} s")
    errors.set(xlabel="dt [s]", ylabel="worst error of the angle [rad]")
    errors.set_xticks(steps, [f"{dt:g}" for dt in steps], rotation=30.0)
    errors.minorticks_off()
    swings.set_ylim(-65.0, 95.0)
    swings.legend(loc="upper center", ncols=3)
    errors.legend()
    figure.savefig(path)
    return numbers


def swing(scene: wg.Scene) -> tuple[FloatArray, FloatArray]:
    """Return time [s] and angle [rad] of the first grain after every step."""
    simulation = wg.Simulation(scene)
    places = []
    for _ in range(scene.steps):
        simulation.step()
        places.append(simulation.position[0])
    x, y = np.transpose(places)
    return scene.dt * np.arange(1, scene.steps + 1), np.arctan2(x, -y)


def pendulum(scene: wg.Scene, time: FloatArray) -> FloatArray:
    """Return the angle [rad] at some times [s] of the pendulum that the first grain is, let go at rest."""
    from scipy.special import ellipj, ellipk

    x, y = scene.position[0]
    k = np.sin(np.arctan2(x, -y) / 2.0)  # sin(angle / 2) = k sn(w t + K, k)
    rate = np.sqrt(np.hypot(*scene.gravity) / np.hypot(x, y))
    return np.asarray(2.0 * np.arcsin(k * ellipj(rate * time + ellipk(k**2), k**2)[0]))
