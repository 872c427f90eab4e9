/* A homework with mistakes: the text's loops, each of whose terms, such as GAP, is right or one of the wrong expressions
 * of mistakes.toml. mistakes.h, made of them, defines GAP(right) as the expression that variant[TERM] chooses. */

#include <float.h>

#include "fem.h"
#include "mistakes.h"

#define MOST_CALLS 2000 /* of a loop that has no end */
#define RECORDED 1024

typedef struct {
    int n, iter; /* iter < 0: femGrainsUpdate */
    double dt, tol, iterMax, radiusIn, radiusOut, gravity[2], gamma;
    const double *state;
} Probe;

typedef struct {
    int calls, recorded, outside; /* outside: index of dvContacts beyond the array; -1: none */
    double zeta;
    double *state, *before, *record; /* record: iter, dt, zeta of each call */
} Answer;

static int visitPair(const int *variant, femGrains *g, int i, int j, int number, double dt, int iter, const double *stale, double *sum) {
    double *x = g->x, *y = g->y, *vx = g->vx, *vy = g->vy, zeta = *sum;
    int n = g->n;
    double ri = g->r[i], rj = g->r[j], mi = g->m[i], mj = g->m[j];
    double dx = DX(x[j] - x[i]), dy = DY(y[j] - y[i]);
    double px = dx + dt * (vx[j] - vx[i]), py = dy + dt * (vy[j] - vy[i]); /* at the end of the step */
    double r = DISTANCE(sqrt(dx * dx + dy * dy)), pr = sqrt(px * px + py * py);
    double nx = NX(dx / r), ny = NY(dy / r);
    double gap = GAP(r - (ri + rj)), rate = RATE(gap / dt);
    double ui = vx[i], wi = vy[i], uj = vx[j], wj = vy[j];
    if (JACOBI_PAIRS(0)) ui = stale[i], wi = stale[n + i], uj = stale[j], wj = stale[n + j];
    if (number < 0 || number >= n * (n - 1) / 2) return 0;
    double *dvc = g->dvContacts, kept = dvc[number];
    double vn = VN((ui - uj) * nx + (wi - wj) * ny);
    double inside = INSIDE(vn + kept - rate), value = CLAMPED(fmax(0.0, inside));
    double dv = iter == 0 && !FIRST_PAIRS(0) ? START(kept) : CHANGE(value - kept);
    double applied = iter == 0 ? dv : APPLIED(dv);
    if (SKIPS_ZERO(0) && applied == 0.0) return 1;
    double part_i = SHARE_I(mj / (mi + mj)), part_j = SHARE_J(mi / (mi + mj));
    vx[i] -= applied * NXI(nx) * part_i;
    vy[i] -= applied * NYI(ny) * part_i;
    vx[j] += applied * NXJ(nx) * part_j;
    vy[j] += applied * NYJ(ny) * part_j;
    if (iter == 0 && !FIRST_PAIRS(0)) {
        dvc[number] = KEPT_AT_START(kept);
        *sum = fmax(zeta, fabs(dv));
        return 1;
    }
    dvc[number] = KEPT(kept + dv);
    double size = SIZE(fabs(dv));
    *sum = ZETA(fmax(zeta, size));
    return 1;
}

static void visitWalls(const int *variant, femGrains *g, int i, double dt, int iter, const double *stale, double *sum) {
    double *vx = g->vx, *vy = g->vy, *dvb = g->dvBoundary, x = g->x[i], y = g->y[i], ri = g->r[i], m = g->m[i], zeta = *sum;
    double rIn = R_IN(g->radiusIn), rOut = R_OUT(g->radiusOut), px = x + dt * vx[i], py = y + dt * vy[i];
    double r = WALL_DISTANCE(sqrt(x * x + y * y)), pr = sqrt(px * px + py * py);
    double nx = WALL_NX(x / r), ny = WALL_NY(y / r);
    double u = vx[i], w = vy[i], kept = dvb[i];
    if (JACOBI_WALLS(0)) u = stale[i], w = stale[g->n + i];
    double vn = WALL_VN(u * nx + w * ny);
    double gapOut = GAP_OUT(rOut - r - ri), gapIn = GAP_IN(r - rIn - ri);
    double rateOut = RATE_OUT(gapOut / dt), rateIn = RATE_IN(gapIn / dt);
    double insideOut = INSIDE_OUT(vn + kept - rateOut), insideIn = INSIDE_IN(-vn - kept - rateIn);
    double out = OUT(fmax(0.0, insideOut)), in = IN(fmax(0.0, insideIn));
    double dv = iter == 0 && !FIRST_WALLS(0) ? WALL_START(kept) : WALL_CHANGE(out - in - kept);
    double applied = iter == 0 ? dv : WALL_APPLIED(dv);
    vx[i] -= WALL_PUSH(applied) * WALL_NXI(nx);
    vy[i] -= WALL_PUSH(applied) * WALL_NYI(ny);
    if (iter == 0 && !FIRST_WALLS(0)) {
        dvb[i] = WALL_KEPT_AT_START(kept);
        *sum = fmax(zeta, fabs(dv));
        return;
    }
    dvb[i] = WALL_KEPT(kept + dv);
    double size = WALL_SIZE(fabs(dv));
    *sum = WALL_ZETA(fmax(zeta, size));
}

/* One iteration; `outside` becomes the index of a contact that has no place, and the iteration ends. */
static double iterate(const int *variant, femGrains *g, double dt, int iter, int *outside) {
    int n = g->n, k = 0;
    double zeta = 0.0, stale[2 * n];
    memcpy(stale, g->vx, n * sizeof(double));
    memcpy(stale + n, g->vy, n * sizeof(double));
    if (iter == 0 && CLEARED(0)) {
        memset(g->dvContacts, 0, n * (n - 1) / 2 * sizeof(double));
        memset(g->dvBoundary, 0, n * sizeof(double));
    }
    for (int stage = 0; stage < 2; stage++) {
        if (stage == WALLS_AT(1)) {
            if (iter > 0) zeta = ZETA_BEFORE_WALLS(zeta);
            for (int i = WALL_FROM(0); i < WALL_TO(n); i++) visitWalls(variant, g, i, dt, iter, stale, &zeta);
            continue;
        }
        for (int time = 0; time < TIMES(1); time++) {
            if (time > 0) k = 0;
            for (int a = FROM_A(0); a < n; a++) {
                if (INDEX_RESET(0)) k = 0;
                if (WALLS_INSIDE(0)) visitWalls(variant, g, a, dt, iter, stale, &zeta);
                for (int b = FROM_B(a + 1); b < TO_B(n); b++) {
                    int i = I(a), j = J(b);
                    if (i == j && SKIPS_ITSELF(0)) continue;
                    int number = INDEX(k);
                    if (!visitPair(variant, g, i, j, number, dt, iter, stale, &zeta)) {
                        *outside = number;
                        return 0.0;
                    }
                    k += INDEX_STEP(1);
                }
            }
        }
    }
    return RETURNED(zeta);
}

static void newton(const int *variant, femGrains *g, double dt) {
    double gamma = g->gamma, gx = g->gravity[0], gy = g->gravity[1];
    for (int i = NEWTON_FROM(0); i < NEWTON_TO(g->n); i++) {
        double u = g->vx[i], v = g->vy[i], m = g->m[i];
        double ax = GRAVITY_X(gx) - DRAG_X(gamma / m * u);
        double unew = NEW_VX(u + dt * ax);
        double ay = GRAVITY_Y(gy) - DRAG_Y(gamma / m * v);
        double vnew = NEW_VY(v + dt * ay);
        g->vx[i] = unew;
        g->vy[i] = vnew;
    }
}

static void move(const int *variant, femGrains *g, double dt) {
    for (int i = 0; i < g->n; i++) {
        double u = g->vx[i], v = g->vy[i], m = g->m[i];
        g->x[i] += MOVE_X(dt * u);
        g->y[i] += MOVE_Y(dt * v);
    }
}

static void solve(const int *variant, femGrains *g, const Probe *p, Answer *answer) {
    static const int right[TERMS];
    double tol = p->tol, iterMax = p->iterMax, dt = p->dt, zeta = 0.0;
    int iter = 0;
    if (NOT_CALLED(0)) return;
    if (UPDATE_CLEARS(0)) {
        memset(g->dvContacts, 0, g->n * (g->n - 1) / 2 * sizeof(double));
        memset(g->dvBoundary, 0, g->n * sizeof(double));
    }
    do {
        double *call = answer->record + 3 * answer->calls;
        if (answer->calls == 0) memcpy(answer->before, g->x, 4 * g->n * sizeof(double)); /* x, y, vx, vy in a row */
        call[0] = PASSED_ITER(iter);
        call[1] = PASSED_DT(dt);
        zeta = call[2] = iterate(right, g, call[1], (int)call[0], &answer->outside);
        answer->calls++;
        if (NEWTON_AT(1) == 3) newton(variant, g, dt);
        iter++;
    } while ((GO_ON((iter == 1 || zeta > tol) && iter <= iterMax)) && answer->calls < MOST_CALLS);
}

/* Answer a probe as a homework does that has some variants in iteration 0, and some in the others and in femGrainsUpdate. */
void answer(const int *first, const int *variant, const Probe *p, Answer *answer) {
    int n = p->n;
    double *s = answer->state;
    memcpy(s, p->state, (7 * n + n * (n - 1) / 2) * sizeof(double));
    memset(answer->before, 0, 4 * n * sizeof(double));
    femGrains g = {n, p->radiusIn, p->radiusOut, {p->gravity[0], p->gravity[1]}, p->gamma,
                   s, s + n, s + 2 * n, s + 3 * n, s + 4 * n, s + 5 * n, s + 6 * n, s + 7 * n};
    answer->calls = 0;
    answer->outside = -1;
    answer->zeta = 0.0;
    if (p->iter >= 0) {
        answer->zeta = iterate(p->iter > 0 ? variant : first, &g, p->dt, p->iter, &answer->outside);
    } else
        for (int stage = 0; stage < 7; stage++) {
            if (stage == NEWTON_AT(1)) newton(variant, &g, p->dt);
            if (stage == 3) solve(variant, &g, p, answer);
            if (stage == MOVE_AT(5) || stage == MOVED_ALSO_AT(-1)) move(variant, &g, p->dt);
        }
    answer->recorded = answer->calls < RECORDED ? answer->calls : RECORDED;
}

static double largest(const double *values, int count, double most) {
    for (int k = 0; k < count; k++)
        if (isfinite(values[k]) && fabs(values[k]) > most) most = fabs(values[k]);
    return most;
}

static int same(const double *a, const double *b, int count, double most) {
    for (int k = 0; k < count; k++)
        if (!(fabs(a[k] - b[k]) <= most) && a[k] != b[k] && !(isnan(a[k]) && isnan(b[k]))) return 0;
    return 1;
}

/* Tell whether two answers differ by rounding only: compare.py, with ten times its bound. */
static int agree(const Probe *p, const Answer *a, const Answer *b) {
    int n = p->n, all = n + n * (n - 1) / 2, calls = a->calls > 1 ? a->calls : 1;
    double least = p->radiusOut / p->dt;
    double speed = fmin(largest(a->state + 6 * n, all, largest(a->state + 2 * n, 2 * n, least)),
                        largest(b->state + 6 * n, all, largest(b->state + 2 * n, 2 * n, least)));
    speed *= 320 * DBL_EPSILON * all * calls;
    double length = p->dt * speed + 320 * DBL_EPSILON * p->radiusOut;
    int open = b->calls != a->calls; /* iteration 0 may count for iterMax or not */
    if (open && !(b->calls == a->calls - 1 && b->calls == p->iterMax)) return 0;
    if (a->calls > 0) {
        if (!same(a->before, b->before, 2 * n, length)) return 0;
        if (!same(a->before + 2 * n, b->before + 2 * n, 2 * n, speed)) return 0;
        for (int k = 0; k < 3 * b->recorded; k += 3) {
            if ((a->record[k] > 0) != (b->record[k] > 0) || a->record[k + 1] != b->record[k + 1]) return 0;
            if (a->record[k] > 0 && !same(a->record + k + 2, b->record + k + 2, 1, speed)) return 0;
        }
    }
    if (open) return 1;
    if (p->iter > 0 && !same(&a->zeta, &b->zeta, 1, speed)) return 0;
    return same(a->state, b->state, 2 * n, length) && same(a->state + 2 * n, b->state + 2 * n, 5 * n + all - n, speed);
}

/* The answers of a homework, to `count` of the probes; the first that is wrong, or `count`; and the index beyond
 * dvContacts with which the homework ended instead of the next answer, or -1. */
typedef struct {
    int count, first, outside;
    const Probe *probes;
    const Answer *answers;
} Found;

static int explains(int variants[2][TERMS], const Found *found, Answer *own) {
    for (int k = -1; k < found->count; k++) {
        int at = k < 0 ? found->first : k; /* most are refuted by the first wrong answer */
        if (at == found->count || k == found->first) continue;
        answer(variants[0], variants[1], found->probes + at, own);
        if (own->outside >= 0 || !agree(found->probes + at, own, found->answers + at)) return 0;
    }
    if (found->outside < 0) return 1;
    answer(variants[0], variants[1], found->probes + found->count, own);
    return own->outside == found->outside;
}

/* Put a mistake into the variants of iteration 0 (when & 1) and the others (when & 2); 0: a term is wrong already. */
static int put(int variants[2][TERMS], const int *mistake, int when) {
    for (int k = 0; k < 2 * TERMS; k++)
        if ((when & 1 << k / TERMS) && mistake[k % TERMS]) {
            if (variants[k / TERMS][k % TERMS]) return 0;
            variants[k / TERMS][k % TERMS] = mistake[k % TERMS];
        }
    return 1;
}

/* Find the pairs of mistakes, or with when[1] = 0 the single ones, that explain all answers: their number, at most `most`. */
int search(const int when[2], int mistakes, const int *terms, const Found *found, Answer *own, int most, int *explaining) {
    int hits = 0;
    for (int a = 0; a < mistakes; a++)
        for (int b = when[1] ? a + 1 : a; b < (when[1] ? mistakes : a + 1); b++) {
            int variants[2][TERMS] = {0};
            if (!put(variants, terms + a * TERMS, when[0]) || !put(variants, terms + b * TERMS, when[1])) continue;
            if (!explains(variants, found, own)) continue;
            explaining[2 * hits] = a;
            explaining[2 * hits++ + 1] = b;
            if (hits == most) return hits;
        }
    return hits;
}
