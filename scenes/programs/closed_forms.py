"""Experiments with closed forms: one disc that slides, rolls, hits a wall or swings, and three discs.

Each function is one experiment. Tests compare its numbers with the closed form, and sections draw them.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import ellipj, ellipk
from sections import Numbers, Row, Section, draw_orders, panels

import warpgrains as wg
from warpgrains.base.arrays import FloatArray

RADIUS = 0.5
G = 9.81
FRICTIONS = (0.1, 0.3, 0.6)  # on slopes
SCHEMES = {
    "euler, tangent": {"scheme": "euler", "wall": "tangent"},
    "leapfrog, round wall": {"scheme": "leapfrog", "wall": "round"},
}


def disc(**changes: Any) -> wg.Scene:
    """Return a scene of one disc of radius 0.5 m that touches a circle of radius 1.5 m, without gravity.

    `changes` replace its fields.
    """
    fields: dict[str, Any] = {
        "position": [[1.0, 0.0]],
        "radius": RADIUS,
        "mass": 1.0,
        "radius_out": 1.5,
        "gravity": (0.0, 0.0),
        "friction": 0.3,
        "tolerance": 1e-12,
        **SCHEMES["leapfrog, round wall"],
    }
    return wg.Scene(**{**fields, **changes})


def slide_to_roll(friction: float, steps: int = 3000) -> tuple[FloatArray, FloatArray]:
    """Simulate a disc that at first slides at 1 m/s without rotation.

    Returns its speed and its rim speed (radius times spin) after every step [m/s], shape (steps,) each.
    """
    simulation = wg.Simulation(disc(velocity=[[0.0, 1.0]], friction=friction))
    speeds = np.empty((2, steps))
    for k in range(steps):
        simulation.step()
        speeds[:, k] = np.hypot(*simulation.velocity[0]), RADIUS * simulation.spin[0]
    return speeds[0], speeds[1]


def oblique_impact(friction: float, slip: float = 1.0) -> tuple[FloatArray, float]:
    """Let a disc with normal velocity 1 m/s and tangential velocity `slip` [m/s] hit a wall.

    Returns its velocity and its rim speed (radius times spin) after the impact [m/s]. The disc starts 10
    steps of 1 nm before the wall, which is a circle; until the contact, its normal turns by only 1e-8.
    """
    start = {"position": [[1.0 - 1e-8, 0.0]], "velocity": [[1.0, slip]]}
    simulation = wg.Simulation(disc(**start, friction=friction, dt=1e-9, **SCHEMES["euler, tangent"]))
    simulation.advance(20)
    return simulation.velocity[0], RADIUS * float(simulation.spin[0])


def rolling_period(dt: float) -> float:
    """Return the period [s] of a disc that rolls in the circle, with an amplitude of 0.5 rad."""
    start = [np.sin(0.5), -np.cos(0.5)]
    simulation = wg.Simulation(disc(position=[start], gravity=(0.0, -G), friction=1.0, dt=dt))
    times, last = [], start[0]
    while len(times) < 3:
        simulation.step()
        x = simulation.position[0, 0]
        if (x > 0.0) != (last > 0.0):
            times.append(simulation.time - dt * x / (x - last))
        last = x
    return float(times[2] - times[0])


def exact_rolling_period() -> float:
    """Return the exact period of a disc that rolls in the circle [s].

    It is that of a pendulum of length 3 (R - r) / 2.
    """
    return float(4.0 * np.sqrt(1.5 / G) * ellipk(np.sin(0.25) ** 2))


def on_a_slope(tangent_of_slope: float, friction: float, rolling: float = 0.0) -> wg.Simulation:
    """Return the simulation of a disc that started at rest on a slope half a second ago.

    `rolling` is the rolling friction. The slope is a circle so large that it is flat within a meter.
    """
    slope, floor = np.arctan(tangent_of_slope), 1e6
    gravity, start = G * np.array([np.sin(slope), -np.cos(slope)]), [[0.0, -(floor - RADIUS)]]
    resists = {"friction": friction, "rolling_friction": rolling}
    scene = disc(position=start, radius_out=floor, gravity=gravity, wall="tangent", **resists)
    simulation = wg.Simulation(scene)
    simulation.advance(50)
    return simulation


def acceleration_on_a_slope(tangent_of_slope: float, friction: float, rolling: float = 0.0) -> float:
    """Return the exact acceleration of a disc on a slope [m/s2], whether it sticks, rolls or slides."""
    slope = np.arctan(tangent_of_slope)
    if tangent_of_slope <= min(friction, rolling):
        return 0.0
    if tangent_of_slope <= 3.0 * friction - 2.0 * rolling:
        return float(2.0 / 3.0 * G * (np.sin(slope) - rolling * np.cos(slope)))
    return float(G * (np.sin(slope) - friction * np.cos(slope)))


def measured_on_a_slope(tangent_of_slope: float, friction: float, rolling: float = 0.0) -> float:
    """Return the measured acceleration of the disc of `on_a_slope` [m/s2]: final velocity divided by time.

    In the leapfrog scheme, the velocity belongs to half a step before the end.
    """
    run = on_a_slope(tangent_of_slope, friction, rolling)
    return float(run.velocity[0, 0] / (run.time - run.scene.dt / 2.0))


def draw_accelerations(axes: Any, acceleration: Callable[[float, float], float]) -> float:
    """Draw accelerations of a disc over the slope for several coefficients of friction, and the closed form.

    `acceleration` returns a measured acceleration [m/s2] for tan(slope) and friction. Returns the largest
    difference of a measured acceleration from the closed form [m/s2].
    """
    tangents, worst = np.linspace(0.0, 2.0, 21), 0.0
    for friction in FRICTIONS:
        found = [acceleration(tangent, friction) for tangent in tangents]
        exact = [acceleration_on_a_slope(tangent, friction) for tangent in tangents]
        (line,) = axes.plot(tangents, found, ".", label=f"friction {friction:g}")
        axes.plot(tangents, exact, color=line.get_color(), linewidth=0.8)
        worst = max(worst, float(np.abs(np.subtract(found, exact)).max()))
    axes.set(xlabel="slope, tan(theta)", ylabel="acceleration [m/s2]")
    return worst


def three_discs(friction: float) -> tuple[wg.Simulation, float]:
    """Simulate two discs on a floor and one on top of them for a second.

    Returns the simulation, and the distance by which the upper disc has fallen [m].
    """
    floor = 1e4
    y = -np.sqrt((floor - RADIUS) ** 2 - RADIUS**2)
    top = y + np.sqrt(3.0) * RADIUS
    scene = disc(
        position=[[-RADIUS, y], [RADIUS, y], [0.0, top]],
        radius_out=floor,
        gravity=(0.0, -G),
        friction=friction,
        wall_friction=1.0,
        dt=0.001,
        tolerance=1e-9,
        max_iterations=100_000,
        wall="tangent",
    )
    simulation = wg.Simulation(scene)
    simulation.advance(1000)
    return simulation, float(top - simulation.position[2, 1])


def heap_friction(slope: float) -> float:
    """Return the friction that keeps one disc on two at rest, if the floor below each has a slope [rad].

    Unknown are the forces on a lower disc: the normal and the tangential one from the upper disc, and the
    normal one from the floor, in weights of a disc. Because moments balance, the tangential force of the
    floor equals that of the upper disc. The equations are the balance of half of the upper disc, and those of
    the lower disc along x and y. On a flat floor the result is tan(15 degrees).
    """
    s, c, sin, cos = 0.5, np.sqrt(0.75), np.sin(slope), np.cos(slope)
    balance = [[c, s, 0.0], [s, -c - cos, -sin], [-c, -s - sin, cos]]
    normal, tangential, _ = np.linalg.solve(balance, [0.5, 0.0, 1.0])
    return float(tangential / normal)


def swing(scene: wg.Scene) -> tuple[FloatArray, FloatArray]:
    """Return time [s] and angle from the lowest point [rad] of the first grain after every step."""
    simulation, places = wg.Simulation(scene), []
    for _ in range(scene.steps):
        simulation.step()
        places.append(simulation.position[0])
    x, y = np.transpose(places)
    return scene.dt * np.arange(1, scene.steps + 1), np.arctan2(x, -y)


def pendulum(scene: wg.Scene, time: FloatArray) -> FloatArray:
    """Return the exact angle of the first grain [rad] at times [s], as a pendulum that starts at rest."""
    x, y = scene.position[0]
    k = np.sin(np.arctan2(x, -y) / 2.0)  # sin(angle / 2) = k sn(w t + K, k)
    rate = np.sqrt(np.hypot(*scene.gravity) / np.hypot(x, y))
    return np.asarray(2.0 * np.arcsin(k * ellipj(rate * time + ellipk(k**2), k**2)[0]))


def one_disc() -> Section:
    """Draw four experiments with one disc next to their closed forms.

    Return the figure, the errors, and the falls of the upper one of three discs.
    """
    figure, ((roll, impact), (slope, period)) = panels(2, 2, height=6.4)
    numbers: Numbers = {}
    for friction in (0.05, 0.3, 2.0):
        speed, rim = slide_to_roll(friction)
        time = 0.01 * np.arange(1, len(speed) + 1)
        (line,) = roll.plot(time, speed, label=f"friction {friction:g}")
        roll.plot(time, -rim, "--", color=line.get_color())
        worst = max(abs(speed[-1] - 2.0 / 3.0), abs(rim[-1] + 2.0 / 3.0))
        numbers[f"slide to roll, mu {friction:g}: error [m/s]"] = float(worst)
    roll.axhline(2.0 / 3.0, color="0.6", linestyle=":")
    roll.set(xlabel="t [s]", ylabel="speed, and rim speed (dashed) [m/s]", xscale="log")

    slips, worst = np.linspace(0.0, 2.5, 26), 0.0
    for friction in (0.1, 0.3, 5.0):
        found = [slip - oblique_impact(friction, slip)[0][1] for slip in slips]
        expected = np.minimum(friction, slips / 3.0)
        (line,) = impact.plot(slips, found, ".", label=f"friction {friction:g}")
        impact.plot(slips, expected, color=line.get_color(), linewidth=0.8)
        worst = max(worst, float(np.abs(found - expected).max()))
        velocity, rim_speed = oblique_impact(friction)
        numbers[f"impact, mu {friction:g}: tangential velocity [m/s]"] = float(velocity[1])
        numbers[f"impact, mu {friction:g}: rim speed [m/s]"] = rim_speed
    numbers["impact: worst error of the impulse ratio"] = worst
    impact.set(xlabel="slip / normal velocity", ylabel="tangential / normal impulse")

    numbers["slope: worst error of the acceleration [m/s2]"] = draw_accelerations(slope, measured_on_a_slope)

    steps, exact = 0.01 * 2.0 ** -np.arange(4), exact_rolling_period()
    errors = np.array([abs(rolling_period(dt) / exact - 1.0) for dt in steps])
    period.loglog(steps, errors, "o-", label="rolling pendulum")
    draw_orders(period, steps, errors, ylabel="relative error of the period")
    numbers["pendulum: relative error of the period at dt 0.01 s"] = float(errors[0])
    numbers["pendulum: order in dt"] = float(np.log2(errors[-2] / errors[-1]))
    for axes in (roll, impact, slope, period):
        axes.legend()
    for friction in (0.265, 0.27):
        numbers[f"three discs, mu {friction:g}: fallen in 1 s [m]"] = three_discs(friction)[1]
    return figure, numbers


def heap() -> Section:
    """Draw three discs in a heap, with more and with less friction than they need to stay at rest.

    Return the figure, the friction that they need, and the falls of the upper disc [m].
    """
    scene, row = wg.Scene.load("heap"), Row(3)
    needed = heap_friction(np.arcsin(scene.radius[0] / (scene.radius_out - scene.radius[0])))
    numbers = {"friction that the heap needs": needed}
    for axes, friction in zip(row.axes, (scene.friction, 1.01 * needed, 0.99 * needed), strict=True):
        simulation = wg.Simulation(scene.replace(friction=friction))
        simulation.run()
        row.show(simulation, largest=2.0, frame="-0.25,-1.03,0.25,-0.73")
        axes.set_title(f"friction {friction:.4f}")
        fallen = scene.position[2, 1] - simulation.position[2, 1]
        numbers[f"fallen at {friction:.4f} [m]"] = float(fallen)
    return row.figure, numbers


def bowl() -> Section:
    """Draw the angle of a grain that swings in a bowl, by each scheme and for an exact pendulum.

    Return the figure and, for each scheme, the order of the error of the angle in dt.
    """
    scene = wg.Scene.load("bowl")
    steps = scene.dt * 2.0 ** -np.arange(-3, 4)
    figure, (swings, errors) = panels(1, 2)
    numbers = {}
    for label, changes in SCHEMES.items():
        worst = []
        for dt in steps:
            time, angle = swing(scene.replace(dt=dt, **changes))
            worst.append(float(np.abs(angle - pendulum(scene, time)).max()))
            if dt == steps[0]:
                swings.plot(time, np.degrees(angle), label=label)
        errors.loglog(steps, worst, "o-", label=label)
        numbers[f"order, {label}"] = float(np.log2(worst[-2] / worst[-1]))
    swings.plot(time, np.degrees(pendulum(scene, time)), "k:", label="pendulum")
    swings.set(xlabel="t [s]", ylabel="angle [degrees]", title=f"dt {steps[0]:g} s", ylim=(-65.0, 95.0))
    swings.legend(loc="upper center", ncols=3)
    errors.set(xlabel="dt [s]", ylabel="worst error of the angle [rad]")
    errors.set_xticks(steps, [f"{dt:g}" for dt in steps], rotation=30.0)
    errors.minorticks_off()
    errors.legend()
    return figure, numbers
