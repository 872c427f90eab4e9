"""The mistakes of femGrainsUpdate that are known by name."""

from warpgrains.grade.compiler import UPDATE
from warpgrains.grade.mistake import Mistake

_LAW = "return v + dt * (gravity - g->gamma / m * v);"
_X = "myGrains->vx[i] = freeVelocity(myGrains, myGrains->vx[i], myGrains->gravity[0], m, dt);"
_Y = "myGrains->vy[i] = freeVelocity(myGrains, myGrains->vy[i], myGrains->gravity[1], m, dt);"
_NEWTON = f"        {_X}\n        {_Y}\n"
_MASS = "double m = myGrains->m[i];"
_UNUSED = (_MASS, "(void)freeVelocity;")
_MOVE_X = "myGrains->x[i] += dt * myGrains->vx[i];"
_MOVE_Y = "myGrains->y[i] += dt * myGrains->vy[i];"
_MOVE = f"    for (int i = 0; i < n; i++) {{\n        {_MOVE_X}\n        {_MOVE_Y}\n    }}\n"
_END = "    myGrains->staggered = myGrains->leapfrog;\n"
_FIRST = "    femGrainsContactIterate(myGrains, dt, 0);\n"
_LOOP = "} while (iter < iterMax && zeta > tol);"
_ITERATE = "zeta = femGrainsContactIterate(myGrains, dt, iter);"


def _update(name: str, advice: str, *changes: tuple[str, str]) -> Mistake:
    return Mistake(name, UPDATE, advice, changes)


def _law(instead: str) -> tuple[str, str]:
    """Return another law than v + dt (gravity - drag / m v)."""
    return _LAW, f"return {instead};"


UPDATE_MISTAKES = (
    _update(
        "not written",
        "velocities, then iterations",
        (_NEWTON, ""),
        _UNUSED,
        (_FIRST, ""),
        (_ITERATE, "zeta = 0.0 * dt;"),
    ),
    _update("gravity missing", "m dv/dt = m g - gamma v", _law("v + 0.0 * gravity - dt * g->gamma / m * v")),
    _update(
        "gravity sign wrong", "gravity[1] is negative already", _law("v - dt * (gravity + g->gamma / m * v)")
    ),
    _update(
        "gravity without x", "gravity has two components", (_X, _X.replace("myGrains->gravity[0]", "0.0"))
    ),
    _update(
        "gravity times mass",
        "the force m g is divided by m again",
        _law("v + dt * (m * gravity - g->gamma / m * v)"),
    ),
    _update(
        "gravity divided by mass", "gravity is an acceleration", _law("v + dt / m * (gravity - g->gamma * v)")
    ),
    _update("drag missing", "m dv/dt = m g - gamma v", _law("v + dt * gravity + 0.0 * m")),
    _update("drag sign wrong", "drag is against v: - gamma v", _law("v + dt * (gravity + g->gamma / m * v)")),
    _update(
        "drag not divided by mass",
        "dv/dt = g - gamma / m v",
        _law("v + dt * (gravity - g->gamma * v) + 0.0 * m"),
    ),
    _update(
        "drag multiplied by mass", "dv/dt = g - gamma / m v", _law("v + dt * (gravity - g->gamma * m * v)")
    ),
    _update(
        "drag implicit",
        "drag is that of the velocity before the step",
        _law("(v + dt * gravity) / (1.0 + dt * g->gamma / m)"),
    ),
    _update("forces without dt", "dv = dt (g - gamma / m v)", _law("v + gravity - g->gamma / m * v")),
    _update("velocities not updated", "the first stage is Newton's law", (_NEWTON, ""), _UNUSED),
    _update(
        "velocities updated after the contacts",
        "Newton's law is the first stage",
        (_NEWTON, ""),
        _UNUSED,
        (_MOVE, _MOVE.replace("{\n", "{\n        " + _MASS + "\n" + _NEWTON, 1)),
    ),
    _update("no warm start", "the first call of femGrainsContactIterate has iter = 0", (_FIRST, "")),
    _update(
        "warm start applied twice",
        "femGrainsContactIterate is called once with iter = 0",
        (_FIRST, _FIRST * 2),
    ),
    _update("iter not counted", "iter is 0, 1, 2, ...", (_ITERATE, _ITERATE.replace("iter)", "0)"))),
    _update(
        "only one iteration",
        "iterate until zeta <= tol, or iterMax",
        (_LOOP, "} while (0 * (iterMax + tol));"),
    ),
    _update(
        "contacts not called",
        "femGrainsContactIterate is called in the second stage",
        (_FIRST, ""),
        (_ITERATE, "zeta = 0.0 * dt;"),
    ),
    _update(
        "tolerance ignored",
        "stop as soon as zeta <= tol",
        (_LOOP, "} while (iter < iterMax + 0.0 * (zeta + tol));"),
    ),
    _update(
        "stops on the wrong side of the tolerance", "go on while zeta > tol", (_LOOP, _LOOP.replace(">", "<"))
    ),
    _update(
        "tolerance divided by dt",
        "zeta is held against tol itself",
        (_LOOP, _LOOP.replace("tol", "tol / dt")),
    ),
    _update(
        "tolerance multiplied by dt",
        "zeta is held against tol itself",
        (_LOOP, _LOOP.replace("tol", "tol * dt")),
    ),
    _update(
        "iterMax ignored",
        "stop at iterMax as well",
        (_LOOP, "} while (iter < 1000 + 0 * iterMax && zeta > tol);"),
    ),
    _update(
        "corrections cleared",
        "dvContacts and dvBoundary are kept from step to step",
        (
            _FIRST,
            "    for (int i = 0; i < n; i++) myGrains->dvBoundary[i] = 0.0;\n"
            "    for (int k = 0; k < n * (n - 1) / 2; k++) myGrains->dvContacts[k] = 0.0;\n" + _FIRST,
        ),
    ),
    _update("positions not moved", "x += dt v", (_MOVE, "")),
    _update("positions moved twice", "x += dt v, once", (_MOVE, _MOVE * 2)),
    _update(
        "positions moved before the contacts",
        "positions move in the third stage, by the corrected velocities",
        (_FIRST, _MOVE + _FIRST),
        (_MOVE + _END, _END),
    ),
    _update(
        "positions moved by the old velocity",
        "positions move in the third stage, by the corrected velocities",
        (_MASS, f"{_MOVE_X}\n        {_MOVE_Y}\n        {_MASS}"),
        (_MOVE + _END, _END),
    ),
    _update(
        "positions moved without dt",
        "x += dt v",
        (_MOVE_X, _MOVE_X.replace("dt * ", "")),
        (_MOVE_Y, _MOVE_Y.replace("dt * ", "")),
    ),
    _update(
        "positions moved by v / m",
        "dx/dt = v: m in the text is a misprint",
        (_MOVE_X, _MOVE_X.replace(";", " / myGrains->m[i];")),
        (_MOVE_Y, _MOVE_Y.replace(";", " / myGrains->m[i];")),
    ),
    _update(
        "positions moved by v / 2",
        "x += dt v, with the velocity after the contacts",
        (_MOVE_X, _MOVE_X.replace("dt", "0.5 * dt")),
        (_MOVE_Y, _MOVE_Y.replace("dt", "0.5 * dt")),
    ),
)
