"""Wrong homeworks with one mistake each: changes of a right one that is not the reference."""

from right_homeworks import PLAIN

CONTACT, UPDATE = "femGrainsContactIterate", "femGrainsUpdate"

_MASSES = (("m[j] / (m[i]", "m[_] / (m[i]"), ("m[i] / (m[i]", "m[j] / (m[i]"), ("m[_]", "m[i]"))
_LOOP = "(zeta > tol && iter <= iterMax) || iter == 1"
_IN = "double dvIn = fmax(0.0, -vn - dvBoundary[i] - (rr - rIn - r[i]) / dt);"
_OUT = "double dvOut = fmax(0.0, vn + dvBoundary[i] - (rOut - rr - r[i]) / dt);"
_MOVE = "        x[i] += vx[i] * dt;\n        y[i] += vy[i] * dt;\n"

WRONG = {
    (CONTACT, "masses swapped"): _MASSES,
    (CONTACT, "masses forgotten"): (
        ("m[j] / (m[i] + m[j])", "/ 2"),
        ("m[i] / (m[i] + m[j])", "/ 2"),
        ("* /", "/"),
    ),
    (CONTACT, "not shared"): (("m[j] / (m[i] + m[j])", "1"), ("m[i] / (m[i] + m[j])", "1")),
    (CONTACT, "no warm start"): (
        ("dv = dvContacts[iContact];\n", "dv = 0;\n"),
        ("dv = dvBoundary[i];", "dv = 0;"),
    ),
    (CONTACT, "no warm start of walls"): (("dv = dvBoundary[i];", "dv = 0;"),),
    (CONTACT, "warm start applied twice"): (
        ("dv = dvContacts[iContact];\n", "dv = 2 * dvContacts[iContact];\n"),
        ("dv = dvBoundary[i];", "dv = 2 * dvBoundary[i];"),
    ),
    (CONTACT, "first iteration computes corrections"): (("iter == 0", "iter < 0"),),
    (CONTACT, "first iteration updates corrections"): (
        ("dv = dvContacts[iContact];\n", "dv = dvContacts[iContact]; dvContacts[iContact] += dv;\n"),
        ("dv = dvBoundary[i];", "dv = dvBoundary[i]; dvBoundary[i] += dv;"),
    ),
    (CONTACT, "gap term missing"): ((" - gap / dt", ""),),
    (CONTACT, "gap sign wrong"): (("- gap / dt", "+ gap / dt"),),
    (CONTACT, "gap not divided by dt"): (("- gap / dt", "- gap"),),
    (CONTACT, "wall sign wrong"): (
        ("vx[i] -= dv * nx;", "vx[i] += dv * nx;"),
        ("vy[i] -= dv * ny;", "vy[i] += dv * ny;"),
    ),
    (CONTACT, "wall gap missing"): ((" - (rOut - rr - r[i]) / dt", ""), (" - (rr - rIn - r[i]) / dt", "")),
    (CONTACT, "inner wall forgotten"): ((_IN, "double dvIn = 0.0;"),),
    (CONTACT, "outer wall forgotten"): ((_OUT, "double dvOut = 0.0;"),),
    (CONTACT, "inner wall sign wrong"): (("dvOut - dvIn", "dvOut + dvIn"),),
    (CONTACT, "walls forgotten"): (
        ("for (i = 0; i < n; i++) {\n        double rr", "for (i = 0; i < 0; i++) {\n        double rr"),
    ),
    (CONTACT, "pair correction not clamped at 0"): (
        (
            "dv = fmax(0.0, vn + dvContacts[iContact] - gap / dt) - dvContacts[iContact];",
            "dv = vn - gap / dt;",
        ),
    ),
    (CONTACT, "kept correction forgotten, pairs"): (
        (
            "fmax(0.0, vn + dvContacts[iContact] - gap / dt) - dvContacts[iContact]",
            "fmax(0.0, vn - gap / dt)",
        ),
    ),
    (CONTACT, "contacts indexed by columns"): (
        ("iContact = 0;\n", "\n"),
        (
            "double dv;\n            if (iter == 0) {\n                dv = dvC",
            "double dv;\n            iContact = j * (j - 1) / 2 + i;\n"
            "            if (iter == 0) {\n                dv = dvC",
        ),
    ),
    (CONTACT, "relative velocity sign"): (
        (
            "vx[i] * nx + vy[i] * ny - vx[j] * nx - vy[j] * ny",
            "vx[j] * nx + vy[j] * ny - vx[i] * nx - vy[i] * ny",
        ),
    ),
    (CONTACT, "normal not normalised"): (
        ("(x[j] - x[i]) / rr;", "x[j] - x[i];"),
        ("(y[j] - y[i]) / rr;", "y[j] - y[i];"),
    ),
    (CONTACT, "pair corrections not kept"): (("                dvContacts[iContact] += dv;\n", ""),),
    (CONTACT, "zeta not the maximum"): (("zeta = fmax(zeta, fabs(dv));", "zeta = fabs(dv);"),),
    (CONTACT, "zeta without abs"): (("fmax(zeta, fabs(dv))", "fmax(zeta, dv)"),),
    (CONTACT, "zeta is a sum"): (("zeta = fmax(zeta, fabs(dv))", "zeta += fabs(dv)"),),
    (UPDATE, "gravity missing"): (("m[i] * gx - ", "-"), ("m[i] * gy - ", "-")),
    (UPDATE, "gravity without x"): (("m[i] * gx - ", "-"),),
    (UPDATE, "drag missing"): ((" - gamma * vx[i]", ""), (" - gamma * vy[i]", "")),
    (UPDATE, "drag not divided by mass"): (
        ("gamma * vx", "m[i] * gamma * vx"),
        ("gamma * vy", "m[i] * gamma * vy"),
    ),
    (UPDATE, "gravity divided by mass"): (("m[i] * gx", "gx"), ("m[i] * gy", "gy")),
    (UPDATE, "no warm start"): (("iter = 0;", "iter = 1;"), (" || iter == 1", "")),
    (UPDATE, "only one iteration"): ((_LOOP, "iter == 1"),),
    (UPDATE, "tolerance divided by dt"): (("zeta > tol", "zeta > tol / dt"),),
    (UPDATE, "tolerance ignored"): (("zeta > tol && ", ""),),
    (UPDATE, "positions not moved"): ((_MOVE, ""),),
    (UPDATE, "positions moved twice"): ((_MOVE, _MOVE + _MOVE),),
    (UPDATE, "positions moved before the contacts"): (
        (_MOVE, ""),
        ("* dt / m[i];\n    }\n", "* dt / m[i];\n" + _MOVE + "    }\n"),
    ),
    (UPDATE, "positions moved by the old velocity"): (
        (_MOVE, ""),
        ("        double fx", _MOVE + "        double fx"),
    ),
    (UPDATE, "positions moved by v / m"): (
        ("vx[i] * dt;", "vx[i] * dt / m[i];"),
        ("vy[i] * dt;", "vy[i] * dt / m[i];"),
    ),
}
"""Which function, which mistake, and what is changed in `PLAIN`."""


def wrong(changes: tuple[tuple[str, str], ...]) -> str:
    """Return `PLAIN` with a mistake."""
    text = PLAIN
    for right, instead in changes:
        assert right in text, right
        text = text.replace(right, instead)
    return text
