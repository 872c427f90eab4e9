"""Wrong homeworks with one mistake each, most of them none of written/wrong.toml: changes of a right one."""

from right_homeworks import PLAIN

CONTACT, UPDATE = "femGrainsContactIterate", "femGrainsUpdate"

_MASSES = (("m[j] / (m[i]", "m[_] / (m[i]"), ("m[i] / (m[i]", "m[j] / (m[i]"), ("m[_]", "m[i]"))

_MOVE = "        x[i] += vx[i] * dt;\n        y[i] += vy[i] * dt;\n"

WRONG = {
    (CONTACT, "masses exchanged in the share of a pair"): _MASSES,
    (CONTACT, "iteration 0 does nothing"): (
        ("dv = dvContacts[iContact];\n", "dv = 0;\n"),
        ("dv = dvBoundary[i];", "dv = 0;"),
    ),
    (CONTACT, "iteration 0 does nothing at the walls"): (("dv = dvBoundary[i];", "dv = 0;"),),
    (CONTACT, "iteration 0 applies the kept corrections twice"): (
        ("dv = dvContacts[iContact];\n", "dv = 2 * dvContacts[iContact];\n"),
        ("dv = dvBoundary[i];", "dv = 2 * dvBoundary[i];"),
    ),
    (CONTACT, "iteration 0 adds to the kept corrections"): (
        ("dv = dvContacts[iContact];\n", "dv = dvContacts[iContact]; dvContacts[iContact] += dv;\n"),
        ("dv = dvBoundary[i];", "dv = dvBoundary[i]; dvBoundary[i] += dv;"),
    ),
    (CONTACT, "gap of a pair missing in the max"): ((" - gap / dt", ""),),
    (CONTACT, "gap at both walls missing in the max"): (
        (" - (rOut - rr - r[i]) / dt", ""),
        (" - (rr - rIn - r[i]) / dt", ""),
    ),
    (CONTACT, "no correction at the outer wall: the max is 0"): (
        ("double dvOut = fmax(0.0, vn + dvBoundary[i] - (rOut - rr - r[i]) / dt);", "double dvOut = 0.0;"),
    ),
    (CONTACT, "walls missing"): (
        ("for (i = 0; i < n; i++) {\n        double rr", "for (i = 0; i < 0; i++) {\n        double rr"),
    ),
    (CONTACT, "correction of pairs never decreases: no kept correction in dv, or dv below 0 dropped"): (
        (
            "fmax(0.0, vn + dvContacts[iContact] - gap / dt) - dvContacts[iContact]",
            "fmax(0.0, vn - gap / dt)",
        ),
    ),
    (CONTACT, "number of the contact counted by columns: (0, 1), (0, 2), (1, 2), (0, 3)"): (
        ("iContact = 0;\n", "\n"),
        (
            "double dv;\n            if (iter == 0) {\n                dv = dvC",
            "double dv;\n            iContact = j * (j - 1) / 2 + i;\n"
            "            if (iter == 0) {\n                dv = dvC",
        ),
    ),
    (CONTACT, "zeta without absolute value"): (("fmax(zeta, fabs(dv))", "fmax(zeta, dv)"),),
    (CONTACT, "iteration 1 treated as iteration 0: iter <= 1"): (("iter == 0", "iter <= 1"),),
    (CONTACT, "kept correction at the walls only of the outer wall"): (
        ("dvBoundary[i] += dv;", "dvBoundary[i] = dvOut;"),
    ),
    (CONTACT, "radius of grain 0 for all grains in the gap at the outer wall"): (
        ("(rOut - rr - r[i])", "(rOut - rr - r[0])"),
    ),
    (UPDATE, "positions moved with an extra dt^2 g / 2"): (
        ("vx[i] * dt;", "vx[i] * dt + 0.5 * dt * dt * gx;"),
        ("vy[i] * dt;", "vy[i] * dt + 0.5 * dt * dt * gy;"),
    ),
    (UPDATE, "gravity is -9.81 whatever the scene says"): (("m[i] * gy", "m[i] * -9.81"),),
    (UPDATE, "dt is 0.01 whatever is passed"): (
        ("vx[i] * dt", "vx[i] * 0.01"),
        ("vy[i] * dt", "vy[i] * 0.01"),
    ),
    (UPDATE, "positions not moved if iterMax ends the iterations"): (
        ("    for (i = 0; i < n; ++i) {", "    for (i = 0; i < n && zeta <= tol; ++i) {"),
    ),
    (UPDATE, "gravity missing"): (("m[i] * gx - ", "-"), ("m[i] * gy - ", "-")),
    (UPDATE, "gravity missing in x"): (("m[i] * gx - ", "-"),),
    (UPDATE, "drag missing"): ((" - gamma * vx[i]", ""), (" - gamma * vy[i]", "")),
    (UPDATE, "iter passed begins with 1, or is always 1: no iteration 0"): (
        ("iter = 0;", "iter = 1;"),
        (" || iter == 1", ""),
    ),
    (UPDATE, "only iterations 0 and 1"): (("(zeta > tol && iter <= iterMax) || iter == 1", "iter == 1"),),
    (UPDATE, "tolerance ignored"): (("zeta > tol && ", ""),),
    (UPDATE, "positions not moved"): ((_MOVE, ""),),
    (UPDATE, "positions moved twice"): ((_MOVE, _MOVE + _MOVE),),
    (UPDATE, "positions moved before the contacts"): (
        (_MOVE, ""),
        ("* dt / m[i];\n    }\n", "* dt / m[i];\n" + _MOVE + "    }\n"),
    ),
    (UPDATE, "positions moved by the old velocity, before Newton's law"): (
        (_MOVE, ""),
        ("        double fx", _MOVE + "        double fx"),
    ),
    (UPDATE, "positions moved by v / m: m in the text is a misprint"): (
        ("vx[i] * dt;", "vx[i] * dt / m[i];"),
        ("vy[i] * dt;", "vy[i] * dt / m[i];"),
    ),
}
"""Which function, which mistake, and what is changed in `PLAIN`."""


def wrong(changes):
    text = PLAIN
    for right, instead in changes:
        assert right in text, right
        text = text.replace(right, instead)
    return text
