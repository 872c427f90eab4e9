"""The mistakes of femGrainsContactIterate that are known by name."""

from warpgrains.grade.compiler import CONTACT
from warpgrains.grade.mistake import Mistake

_DV = "dv = fmax(0.0, vn + *dvc - gap / dt) - *dvc;"
_WI = "double wi = mj / (mi + mj);"
_WJ = "double wj = mi / (mi + mj);"
_OUT = "double dvOut = fmax(0.0, vn + *dvb - rateOut);"
_IN = "double dvIn = g->radiusIn > 0.0 ? fmax(0.0, -vn - *dvb - gapIn / dt) : 0.0;"
_WALLS = "dv = dvOut - dvIn - *dvb;"
_PAIR_START = "double dv = *dvc;\n    if (iter > 0) {"
_WALL_START = "double dv = *dvb;\n    if (iter > 0) {"
_PAIR_I = "    g->vx[i] -= dv * nx * wi;\n    g->vy[i] -= dv * ny * wi;\n"
_PAIR_J = "    g->vx[j] += dv * nx * wj;\n    g->vy[j] += dv * ny * wj;\n"
_WALL_I = "    g->vx[i] -= dv * nx;\n    g->vy[i] -= dv * ny;\n"
_PAIRS = (
    "    for (int i = 0; i < n; i++)\n        for (int j = i + 1; j < n; j++)"
    " zeta = fmax(zeta, contactPair(myGrains, i, j, dvc++, dt, iter));\n"
)
_EACH_WALL = (
    "    for (int i = 0; i < n; i++)\n"
    "        zeta = fmax(zeta, contactWalls(myGrains, i, &myGrains->dvBoundary[i], dt, iter));\n"
)


def _contact(name: str, advice: str, *changes: tuple[str, str]) -> Mistake:
    return Mistake(name, CONTACT, advice, changes)


CONTACT_MISTAKES = (
    _contact("not written", "pairs, then walls", (_PAIRS + _EACH_WALL, "    (void)dvc, (void)n;\n")),
    _contact(
        "masses swapped",
        "grain i takes m_j / (m_i + m_j) of dv, grain j takes m_i / (m_i + m_j): the lighter one moves more",
        (_WI, _WI.replace("mj / (", "mi / (")),
        (_WJ, _WJ.replace("mi / (", "mj / (")),
    ),
    _contact(
        "masses forgotten",
        "the two grains share dv by their masses, not half and half",
        (_WI, "double wi = 0.5;"),
        (_WJ, "double wj = 0.5;"),
    ),
    _contact(
        "not shared",
        "each grain takes its share of dv, not all of it",
        (_WI, "double wi = 1.0;"),
        (_WJ, "double wj = 1.0;"),
    ),
    _contact(
        "only one grain corrected",
        "grain j gets the opposite impulse: momentum is kept",
        (_PAIR_J, ""),
        (_WJ, ""),
    ),
    _contact(
        "pair corrected the wrong way",
        "v_i -= dv n m_j / (m_i + m_j), v_j += dv n m_i / (m_i + m_j)",
        (_PAIR_I, _PAIR_I.replace("-=", "+=")),
        (_PAIR_J, _PAIR_J.replace("+=", "-=")),
    ),
    _contact(
        "relative velocity sign",
        "vn = (v_i - v_j) . n, with n from i to j: positive where they approach",
        (
            "double vn = (g->vx[i] - g->vx[j]) * nx + (g->vy[i] - g->vy[j]) * ny;",
            "double vn = (g->vx[j] - g->vx[i]) * nx + (g->vy[j] - g->vy[i]) * ny;",
        ),
    ),
    _contact(
        "normal not normalised",
        "n = (x_j - x_i) / r has length 1",
        ("double nx = dx / r;\n    double ny = dy / r;", "double nx = dx;\n    double ny = dy;"),
    ),
    _contact(
        "no warm start",
        "iteration 0 applies the corrections of the step before to the velocities, at pairs and walls",
        (_PAIR_START, _PAIR_START.replace("*dvc;", "iter > 0 ? *dvc : 0.0;")),
        (_WALL_START, _WALL_START.replace("*dvb;", "iter > 0 ? *dvb : 0.0;")),
    ),
    _contact(
        "no warm start of pairs",
        "iteration 0 applies dvContacts to the velocities",
        (_PAIR_START, _PAIR_START.replace("*dvc;", "iter > 0 ? *dvc : 0.0;")),
    ),
    _contact(
        "no warm start of walls",
        "iteration 0 applies dvBoundary to the velocities",
        (_WALL_START, _WALL_START.replace("*dvb;", "iter > 0 ? *dvb : 0.0;")),
    ),
    _contact(
        "warm start applied twice",
        "iteration 0 applies each correction once",
        (_PAIR_START, _PAIR_START.replace("*dvc;", "iter > 0 ? *dvc : 2.0 * *dvc;")),
        (_WALL_START, _WALL_START.replace("*dvb;", "iter > 0 ? *dvb : 2.0 * *dvb;")),
    ),
    _contact(
        "warm start in every iteration",
        "only iteration 0 applies the kept corrections; later ones apply the change dv",
        (_DV, _DV.replace(" - *dvc;", ";") + "\n        double change = dv - *dvc;"),
        ("*dvc += dv;", "*dvc += change;"),
    ),
    _contact(
        "first iteration computes corrections",
        "iteration 0 applies the kept corrections, and computes none",
        (_PAIR_START, _PAIR_START.replace("iter > 0", "iter >= 0")),
        (_WALL_START, _WALL_START.replace("iter > 0", "iter >= 0")),
    ),
    _contact(
        "first iteration updates corrections",
        "iteration 0 changes velocities only: dvContacts and dvBoundary stay",
        (_PAIR_START, "double dv = *dvc;\n    if (iter == 0) *dvc += dv;\n    if (iter > 0) {"),
        (_WALL_START, "double dv = *dvb;\n    if (iter == 0) *dvb += dv;\n    if (iter > 0) {"),
    ),
    _contact(
        "gap term missing",
        "the gap that may still be closed is taken off: - gamma / dt, of pairs",
        (_DV, _DV.replace(" - gap / dt", "")),
        ("double gap = r - (g->r[i] + g->r[j]);", ""),
    ),
    _contact(
        "gap sign wrong",
        "vn + dv_c - gamma / dt, with minus, of pairs",
        (_DV, _DV.replace("- gap", "+ gap")),
    ),
    _contact(
        "gap not divided by dt", "gamma / dt is a speed, of pairs", (_DV, _DV.replace("gap / dt", "gap"))
    ),
    _contact(
        "gap multiplied by dt", "gamma / dt is a speed, of pairs", (_DV, _DV.replace("gap / dt", "gap * dt"))
    ),
    _contact(
        "radii forgotten in the gap",
        "gamma = r - (r_i + r_j)",
        ("double gap = r - (g->r[i] + g->r[j]);", "double gap = r;"),
    ),
    _contact(
        "kept correction forgotten, pairs",
        "dv = max(0, vn + dv_c - gamma / dt) - dv_c: so a correction can be taken back",
        (_DV, "dv = fmax(0.0, vn - gap / dt);"),
    ),
    _contact(
        "kept correction forgotten, walls",
        "dv_b stands inside both maxima, and is taken off in the end",
        (_OUT, _OUT.replace(" + *dvb", "")),
        (_IN, _IN.replace(" - *dvb", "")),
        (_WALLS, "dv = dvOut - dvIn;"),
    ),
    _contact(
        "pair correction not clamped at 0", "max(0, ...): grains do not pull", (_DV, "dv = vn - gap / dt;")
    ),
    _contact(
        "wall correction not clamped at 0",
        "max(0, ...) for each wall: walls do not pull",
        (_OUT, _OUT.replace("fmax(0.0, ", "(")),
        (_IN, "double dvIn = 0.0 * gapIn;"),
    ),
    _contact("pair corrections not kept", "dv_c += dv", ("        *dvc += dv;\n", "")),
    _contact("wall corrections not kept", "dv_b += dv", ("        *dvb += dv;\n", "")),
    _contact(
        "wall sign wrong",
        "v_i -= dv n at the walls",
        (_WALL_I, _WALL_I.replace("-=", "+=")),
    ),
    _contact(
        "inner wall sign wrong",
        "dv = dv_out - dv_in - dv_b",
        (_WALLS, "dv = dvOut + dvIn - *dvb;"),
    ),
    _contact("inner wall forgotten", "dv = dv_out - dv_in - dv_b", (_IN, "double dvIn = 0.0 * gapIn;")),
    _contact("outer wall forgotten", "dv = dv_out - dv_in - dv_b", (_OUT, "double dvOut = 0.0;")),
    _contact("walls forgotten", "each grain is also held against both walls", (_EACH_WALL, "")),
    _contact("pairs forgotten", "each pair i < j is looked at", (_PAIRS, "    (void)dvc;\n")),
    _contact(
        "wall gap missing",
        "gamma_out and gamma_in are taken off, divided by dt",
        (_OUT, _OUT.replace(" - rateOut", "")),
        (_IN, _IN.replace(" - gapIn / dt", " - 0.0 * gapIn")),
    ),
    _contact(
        "wall gap sign wrong",
        "gamma_out = R_out - r - r_i, gamma_in = r - R_in - r_i, both with minus",
        (_OUT, _OUT.replace("- rateOut", "+ rateOut")),
        (_IN, _IN.replace("- gapIn", "+ gapIn")),
    ),
    _contact(
        "wall gap not divided by dt",
        "gamma / dt is a speed, at the walls",
        (_OUT, _OUT.replace("rateOut", "gapOut")),
        (_IN, _IN.replace("gapIn / dt", "gapIn")),
    ),
    _contact(
        "radius forgotten at the walls",
        "gamma_out = R_out - r - r_i, gamma_in = r - R_in - r_i",
        ("double gapOut = g->radiusOut - r - g->r[i];", "double gapOut = g->radiusOut - r;"),
        ("double gapIn = r - g->radiusIn - g->r[i];", "double gapIn = r - g->radiusIn;"),
    ),
    _contact(
        "contacts indexed by columns",
        "dvContacts holds (0, 1), (0, 2), ..., (1, 2), ...: one index that grows in the double loop",
        (
            "contactPair(myGrains, i, j, dvc++, dt, iter)",
            "contactPair(myGrains, i, j, &dvc[j * (j - 1) / 2 + i], dt, iter)",
        ),
    ),
    _contact(
        "contacts visited backwards",
        "pairs (0, 1), (0, 2), ..., (1, 2), ... one after the other",
        (
            _PAIRS,
            "    for (int i = n - 1; i >= 0; i--)\n"
            "        for (int j = n - 1; j > i; j--)\n"
            "            zeta = fmax(zeta, contactPair(myGrains, i, j,"
            " &dvc[i * (2 * n - i - 1) / 2 + j - i - 1], dt, iter));\n",
        ),
    ),
    _contact("walls before pairs", "pairs first, then walls", (_PAIRS + _EACH_WALL, _EACH_WALL + _PAIRS)),
    _contact(
        "every pair visited twice",
        "j goes from i + 1: each pair once",
        (_PAIRS, _PAIRS + "    dvc = myGrains->dvContacts;\n" + _PAIRS),
    ),
    _contact(
        "last grain forgotten",
        "i goes to n - 1, included, at the walls",
        (_EACH_WALL, _EACH_WALL.replace("i < n", "i < n - 1")),
    ),
    _contact(
        "zeta not the maximum",
        "zeta = max(zeta, |dv|), over all contacts",
        (_PAIRS, _PAIRS.replace("zeta = fmax(zeta, ", "zeta = (")),
        (_EACH_WALL, _EACH_WALL.replace("zeta = fmax(zeta, ", "zeta = (")),
    ),
    _contact(
        "zeta is a sum",
        "zeta = max(zeta, |dv|), over all contacts",
        (_PAIRS, _PAIRS.replace("zeta = fmax(zeta, ", "zeta += (")),
        (_EACH_WALL, _EACH_WALL.replace("zeta = fmax(zeta, ", "zeta += (")),
    ),
    _contact(
        "zeta without abs",
        "zeta = max(zeta, |dv|): dv may be negative",
        (
            "    g->vy[j] += dv * ny * wj;\n    return fabs(dv);",
            "    g->vy[j] += dv * ny * wj;\n    return dv;",
        ),
        ("    g->vy[i] -= dv * ny;\n    return fabs(dv);", "    g->vy[i] -= dv * ny;\n    return dv;"),
    ),
    _contact(
        "zeta without the walls",
        "zeta = max(zeta, |dv|), also of walls",
        (_EACH_WALL, _EACH_WALL.replace("zeta = fmax(zeta, ", "(")),
    ),
    _contact(
        "zeta without the pairs",
        "zeta = max(zeta, |dv|), also of pairs",
        (_PAIRS, _PAIRS.replace("zeta = fmax(zeta, ", "(")),
    ),
    _contact(
        "zeta not returned",
        "zeta is returned",
        (_EACH_WALL + "    return zeta;", _EACH_WALL + "    return 0.0;"),
    ),
)
