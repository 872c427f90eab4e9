/* Model of a homework with mistakes: the loops of the course text, in which each term, such as GAP, is the right expression
 * or a wrong one of mistakes.toml. mistakes.h, which is generated, defines GAP(slot, right): the expression of the number
 * variant[GAP + slot].
 *
 * The slots of a term are the places at which it occurs:
 *
 *     sides         0 a pair, 1 the outer wall, 2 the inner wall
 *     kinds         0 pairs, 1 walls
 *     components    0 x, 1 y; of normals: those of a pair, then those of a wall
 *     velocities    vx_i, vy_i, vx_j, vy_j of a pair, vx and vy at a wall
 *
 * A wrong expression is the same for all slots. Its names, such as `own` and `other` for the two components, stand for the
 * variables of the slot. */

#include <float.h>

#include "fem.h"
#include "mistakes.h"
#include "protocol.h"

#define MOST_CALLS 500 /* a step with more calls is an endless loop */
#define NONE -1
#define ENDLESS -2
#define BEYOND(index) (-3 - (index)) /* index beyond an array of grains */

enum { PAIR, WALL };
enum { OUTER = 1, INNER };

typedef struct {
    Request q;
    const double *state;
} Probe;

typedef struct {
    int calls, recorded, end; /* end: an index beyond dvContacts, or one of the above */
    double zeta;
    double *state, *before, *record; /* record: iter, dt, zeta of each call */
} Answer;

/* Velocities before the iteration, and before row i of the pairs: x and then y. */
typedef struct {
    double *iteration, *row;
} Stale;

typedef struct {
    int i, j;
    double size, masses, first, dt; /* sums of radii and of masses; sum of radii if all were that of grain 0 */
    double ri, rj, r, rIn, rOut;
} Contact;

/* The correction at one side, from the distance between centers, or to a wall, at the start and the end of the step. */
static double needed(const int *variant, int side, const Contact *c, double distance, double moved, double vn, double kept,
                     double *gap) {
    double size = c->size, first = c->first, masses = c->masses, dt = c->dt, ri = c->ri, rj = c->rj;
    *gap = GAP(side, distance - size);
    double rate = RATE(side, *gap / dt), inside = INSIDE(side, vn + kept - rate);
    return CLAMPED(side, fmax(0.0, inside));
}

/* Solve a contact; returns 1 if its gap is open, plus 2 if it needs no correction. */
static int visit(const int *variant, int kind, femGrains *g, int i, int j, int number, double dt, int iter, const Stale *stale,
                  double *sum) {
    int n = g->n, isStart = FIRST(kind, iter == 0);
    double *const q[] = {g->x, g->y}, *const v[] = {g->vx, g->vy}, *slot = (kind == PAIR ? g->dvContacts : g->dvBoundary) + number;
    double d[2], moved[2], normal[2], speed[2], one[2], two[2], kept = *slot, zeta = *sum;
    double ri = g->r[i], rj = kind == PAIR ? g->r[j] : 0.0;
    double mi = g->m[i], mj = kind == PAIR ? g->m[j] : 0.0, rIn = WALL_RADIUS(1, g->radiusIn), rOut = WALL_RADIUS(0, g->radiusOut);
    const double *old = OLD_SPEED(kind, 0) == 1 ? stale->iteration : OLD_SPEED(kind, 0) == 2 ? stale->row : NULL;
    for (int c = 0; c < 2; c++) {
        double qi = q[c][i], qj = q[c][j], oi = q[!c][i], oj = q[!c][j];
        double vi = old ? old[c * n + i] : v[c][i], vj = old == stale->iteration ? old[c * n + j] : v[c][j];
        double ui = v[!c][i], uj = v[!c][j];
        d[c] = kind == PAIR ? DELTA(c, qj - qi) : qi;
        moved[c] = d[c] + dt * (kind == PAIR ? v[c][j] - v[c][i] : v[c][i]);
        speed[c] = kind == PAIR ? RELATIVE(c, vi - vj) : vi;
        one[c] = vi;
        two[c] = vj;
    }
    double a = d[0], b = d[1], size = ri + rj;
    double r = DISTANCE(kind, sqrt(a * a + b * b)), later = sqrt(moved[0] * moved[0] + moved[1] * moved[1]);
    for (int c = 0; c < 2; c++) {
        double own = d[c], other = d[!c];
        normal[c] = NORMAL(2 * kind + c, own / r);
    }
    double s = speed[0], w = speed[1], nx = normal[0], ny = normal[1];
    double vn = VN(kind, s * nx + w * ny), gap, gapIn, out = 0.0, in = 0.0, value;
    Contact contact = {i, j, size, mi + mj, kind == PAIR ? 2 * g->r[0] : g->r[0], dt, ri, rj, r, rIn, rOut};
    if (kind == PAIR) {
        value = needed(variant, PAIR, &contact, r, later, vn, kept, &gap);
    } else {
        out = needed(variant, OUTER, &contact, rOut - r, rOut - later, vn, kept, &gap);
        in = needed(variant, INNER, &contact, r - rIn, later - rIn, -vn, -kept, &gapIn);
        gap = fmin(gap, gapIn);
        value = out - in;
    }
    double dv = isStart ? START(kind, kept) : CHANGE(kind, value - kept);
    int state = (gap >= 0.0) + 2 * (value == 0.0);
    if (isStart) value = kept;
    double applied = APPLIED(kind, dv);
    if (SKIPS_ZERO(0, 0) && applied == 0.0) return 2;
    for (int grain = kind == PAIR ? 0 : 2; grain < (kind == PAIR ? 2 : 3); grain++) /* i, j; i at a wall */
        for (int c = 0; c < 2; c++) {
            int at = grain == 1 ? j : i, to = 2 * grain + c;
            double ms = g->m[at], mo = grain == 1 ? mi : mj, rs = g->r[at], ro = grain == 1 ? ri : rj;
            double own = normal[c], other = normal[!c], *changed = &v[c][TARGET(to, at)], before = *changed;
            double push = applied * ALONG(to, own) * SHARE(to, grain == 2 ? 1.0 : mo / (ms + mo));
            *changed = CHANGED(to, before) + (grain == 1 ? push : -push);
        }
    *slot = isStart ? KEPT_AT_START(kind, kept) : KEPT(kind, kept + dv);
    double change = isStart ? fabs(dv) : SIZE(kind, fabs(dv));
    *sum = isStart ? START_ZETA(kind, fmax(zeta, change)) : ZETA(kind, fmax(zeta, change));
    return state;
}

static void clear(femGrains *g, int kind) {
    memset(kind == PAIR ? g->dvContacts : g->dvBoundary, 0, (kind == PAIR ? g->n * (g->n - 1) / 2 : g->n) * sizeof(double));
}

static void copySpeeds(double *copy, const femGrains *g) {
    memcpy(copy, g->vx, g->n * sizeof(double));
    memcpy(copy + g->n, g->vy, g->n * sizeof(double));
}

/* Does one iteration. It stops at an index beyond an array, and sets `end` to it. */
static double iterate(const int *variant, femGrains *g, double dt, int iter, int *end) {
    int n = g->n, k = 0, walls = WALLS_INSIDE(0, 0);
    double zeta = ZETA_FROM(0, 0.0), speeds[4 * n];
    Stale stale = {speeds, speeds + 2 * n};
    copySpeeds(stale.iteration, g);
    for (int kind = PAIR; kind <= WALL; kind++)
        if (CLEARED(kind, 0)) clear(g, kind);
    for (int stage = 0; stage < 2; stage++) {
        if (stage == WALLS_AT(0, 1)) {
            for (int a = WALL_FROM(0, 0); a < WALL_TO(0, n); a++) {
                if (a == n) *end = BEYOND(n);
                if (a == n) return 0.0;
                visit(variant, WALL, g, a, a, WALL_INDEX(0, a), dt, iter, &stale, &zeta);
            }
            continue;
        }
        for (int time = 0; time < TIMES(0, 1); time++) {
            if (time > 0) k = 0;
            for (int a = FROM_A(0, 0); a < TO_A(0, n); a++) {
                if (a == n) *end = BEYOND(n);
                if (a == n) return 0.0;
                if (OLD_SPEED(PAIR, 0)) copySpeeds(stale.row, g);
                if (INDEX_RESET(0, 0)) k = 0;
                if (walls == 1) visit(variant, WALL, g, a, a, a, dt, iter, &stale, &zeta);
                for (int b = FROM_B(0, a + 1); b < TO_B(0, n); b++) {
                    int i = ROW(0, a), j = COLUMN(0, b);
                    if (i == j && SKIPS_ITSELF(0, 0)) continue;
                    int number = INDEX(0, k), isBeyond = i >= n || j >= n;
                    if (isBeyond || number < 0 || number >= n * (n - 1) / 2) {
                        *end = isBeyond ? BEYOND(n) : number;
                        return 0.0;
                    }
                    int state = visit(variant, PAIR, g, i, j, number, dt, iter, &stale, &zeta);
                    k += INDEX_STEP(0, 1);
                    if (walls == 3) visit(variant, WALL, g, i, i, i, dt, iter, &stale, &zeta);
                }
                if (walls == 2) visit(variant, WALL, g, a, a, a, dt, iter, &stale, &zeta);
            }
        }
    }
    return RETURNED(0, zeta);
}

static void newton(const int *variant, femGrains *g, double dt) {
    double gamma = g->gamma, *const v[] = {g->vx, g->vy};
    for (int i = NEWTON_FROM(0, 0); i < NEWTON_TO(0, g->n) && i < g->n; i++) {
        double m = g->m[i], u = v[0][i], w = v[1][i], speed = sqrt(u * u + w * w);
        for (int c = 0; c < 2; c++) {
            double own = c ? w : u, other = c ? u : w, changed = v[!c][i], a, pull;
            {
                double own = g->gravity[c], other = g->gravity[!c];
                pull = GRAVITY(c, own);
            }
            a = pull - DRAG(c, gamma / m * own);
            v[c][i] = NEWTON(c, own + dt * a);
        }
    }
}

/* Accelerates grains after the contacts, as some mistakes do. */
static void accelerate(const int *variant, femGrains *g, double dt) {
    double gamma = g->gamma, *const v[] = {g->vx, g->vy};
    for (int k = 0; k < 2 * g->n; k++) {
        double pull = g->gravity[k % 2], m = g->m[k / 2], own = v[k % 2][k / 2];
        v[k % 2][k / 2] += dt * LATE(0, 0.0);
    }
}

/* Moves grains by their velocities. A mistake may use those at the start of the step, or before the contacts: x, then y. */
static void move(const int *variant, femGrains *g, double dt, const double *start, const double *free) {
    for (int i = MOVE_FROM(0, 0); i < MOVE_TO(0, g->n) && i < g->n; i++)
        for (int c = 0; c < 2; c++) {
            double *const q[] = {g->x, g->y}, *const v[] = {g->vx, g->vy}, gravity = g->gravity[c];
            double own = v[c][i], other = v[!c][i], first = start[c * g->n + i], freely = free[c * g->n + i];
            double m = g->m[i], before = q[c][i], q_other = q[!c][i];
            q[c][i] = MOVE(c, before + dt * own);
        }
}

static void solve(const int *variant, femGrains *g, const Probe *p, Answer *answer, const double *start, const double *free) {
    static const int right[TERMS];
    double tol = p->q.tol, iterMax = p->q.iterMax, dt = p->q.dt, zeta = 0.0, sum = 0.0, most = 0.0, last = 0.0;
    int iter = 0, forced, goesOn, isBelow;
    if (NOT_CALLED(0, 0)) return;
    do {
        double *call = answer->record + 3 * answer->calls;
        if (NEWTON_EACH(0, 0) == 1 || (NEWTON_EACH(0, 0) == 3 && iter > 0)) newton(variant, g, dt);
        if (MOVE_EACH(0, 0) == 3) move(variant, g, dt, start, free);
        if (answer->calls == 0) memcpy(answer->before, g->x, 4 * g->n * sizeof(double)); /* x, y, vx, vy in a row */
        call[0] = PASSED_ITER(0, iter);
        call[1] = PASSED_DT(0, dt);
        last = zeta;
        zeta = call[2] = iterate(right, g, call[1], (int)call[0], &answer->end);
        sum += zeta;
        most = fmax(most, zeta);
        answer->calls++;
        if (NEWTON_EACH(0, 0) == 2) newton(variant, g, dt);
        if (MOVE_EACH(0, 0) == 1 || (MOVE_EACH(0, 0) == 2 && iter > 0)) move(variant, g, dt, start, free);
        iter += ITER_STEP(0, 1);
        forced = FORCED(0, iter == 1);
        goesOn = TEST(0, zeta > tol);
        isBelow = LIMIT(0, iter <= iterMax);
    } while ((GO_ON(0, (forced || goesOn) && isBelow)) && answer->calls < MOST_CALLS);
    if (answer->calls == MOST_CALLS) answer->end = ENDLESS;
}

static void clearKept(const int *variant, femGrains *g, int when) {
    for (int kind = PAIR; kind <= WALL; kind++)
        if (STEP_CLEARS(kind, 0) == when) clear(g, kind);
}

static void update(const int *variant, femGrains *g, const Probe *p, Answer *answer) {
    double speeds[4 * g->n], *start = speeds, *free = speeds + 2 * g->n;
    copySpeeds(start, g);
    clearKept(variant, g, 1);
    if (NEWTON_TO(0, g->n) > g->n || MOVE_TO(0, g->n) > g->n) answer->end = BEYOND(g->n);
    for (int stage = 0; stage < 7; stage++) {
        if (stage == NEWTON_AT(0, 1)) newton(variant, g, p->q.dt);
        if (stage == 4) accelerate(variant, g, p->q.dt);
        if (stage <= 3) copySpeeds(free, g);
        if (stage == 3) solve(variant, g, p, answer, start, free);
        if (stage == MOVE_AT(0, 5) || stage == MOVED_ALSO_AT(0, -1)) move(variant, g, p->q.dt, start, free);
    }
    clearKept(variant, g, 2);
}

/* Answers a probe like a homework with the variants `first` in iteration 0, and `variant` otherwise. */
void answer(const int *first, const int *variant, const Probe *p, Answer *answer) {
    int n = p->q.n;
    double *s = answer->state;
    memcpy(s, p->state, (7 * n + n * (n - 1) / 2) * sizeof(double));
    memset(answer->before, 0, 4 * n * sizeof(double));
    femGrains g = {n, p->q.radiusIn, p->q.radiusOut, {p->q.gravity[0], p->q.gravity[1]}, p->q.gamma,
                   s, s + n, s + 2 * n, s + 3 * n, s + 4 * n, s + 5 * n, s + 6 * n, s + 7 * n};
    answer->calls = 0;
    answer->end = NONE;
    answer->zeta = 0.0;
    if (p->q.iter >= 0) {
        answer->zeta = iterate(p->q.iter > 0 ? variant : first, &g, p->q.dt, p->q.iter, &answer->end);
    } else {
        update(variant, &g, p, answer);
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

/* Returns whether two answers differ by rounding only, with ten times the bound of compare.py. */
static int agree(const Probe *p, const Answer *a, const Answer *b) {
    int n = p->q.n, all = n + n * (n - 1) / 2, calls = a->calls > 1 ? a->calls : 1;
    double least = p->q.radiusOut / p->q.dt;
    double speed = fmin(largest(a->state + 6 * n, all, largest(a->state + 2 * n, 2 * n, least)),
                        largest(b->state + 6 * n, all, largest(b->state + 2 * n, 2 * n, least)));
    speed *= 320 * DBL_EPSILON * all * calls;
    double length = p->q.dt * speed + 320 * DBL_EPSILON * p->q.radiusOut;
    if (b->calls != a->calls) return 0;
    if (a->calls > 0) {
        if (!same(a->before, b->before, 2 * n, length)) return 0;
        if (!same(a->before + 2 * n, b->before + 2 * n, 2 * n, speed)) return 0;
        for (int k = 0; k < 3 * b->recorded; k += 3) {
            if ((a->record[k] > 0) != (b->record[k] > 0) || a->record[k + 1] != b->record[k + 1]) return 0;
            if (a->record[k] > 0 && !same(a->record + k + 2, b->record + k + 2, 1, speed)) return 0;
        }
    }
    if (p->q.iter > 0 && !same(&a->zeta, &b->zeta, 1, speed)) return 0;
    return same(a->state, b->state, 2 * n, length) && same(a->state + 2 * n, b->state + 2 * n, 5 * n + all - n, speed);
}

/* The answers of a homework to the first `count` probes; indices of the wrong ones, those that decide fastest first; the
 * right answers to the first of these; and how the homework ended at the last probes. */
typedef struct {
    int count, wrongs, ended;
    const int *wrong, *ends;
    const Probe *probes;
    const Answer *answers, *right;
} Found;

#define FEW 3 /* grains of the smallest scene with contacts of all kinds */

typedef int Variants[2][TERMS]; /* those of iteration 0, and of the others */

static int fits(Variants variants, const Found *found, int at, Answer *own) {
    answer(variants[0], variants[1], found->probes + at, own);
    return own->end == NONE && agree(found->probes + at, own, found->answers + at);
}

static int explains(Variants variants, const Found *found, Answer *own) {
    int least = found->wrongs ? found->probes[found->wrong[0]].q.n : 0;
    for (int k = 0; k < found->count && least > FEW; k++) /* cheap */
        if (found->probes[k].q.n == FEW && !fits(variants, found, k, own)) return 0;
    for (int k = 0; k < found->wrongs; k++) /* these refute most explanations */
        if (!fits(variants, found, found->wrong[k], own)) return 0;
    for (int k = 0; k < found->count; k++)
        if (!fits(variants, found, k, own)) return 0;
    for (int k = 0; k < found->ended; k++) {
        answer(variants[0], variants[1], found->probes + found->count + k, own);
        if (own->end != found->ends[k]) return 0;
    }
    return 1;
}

/* Adds a mistake to the variants of iteration 0 (when & 1) and of the others (when & 2). Returns 0 if a term is wrong already. */
static int put(Variants variants, const int *mistake, int when) {
    for (; *mistake >= 0; mistake += 2)
        for (int k = 0; k < 2; k++)
            if (when & 1 << k) {
                if (variants[k][mistake[0]]) return 0;
                variants[k][mistake[0]] = mistake[1];
            }
    return 1;
}

#define LOOKED_AT 4 /* wrong answers */

enum { ACTIVE = 1, FITTING = 2 };

/* Returns whether a mistake alone changes answers to the first wrong probes, and whether it explains one of them. */
static char effectOf(const int *mistake, int when, const Found *found, Answer *own) {
    Variants variants = {0};
    char effect = 0;
    put(variants, mistake, when);
    if (!found->wrongs) {
        answer(variants[0], variants[1], found->probes + found->count, own);
        return own->end == found->ends[0] ? FITTING : 0;
    }
    for (int k = 0; k < LOOKED_AT && k < found->wrongs; k++) {
        int at = found->wrong[k];
        if (fits(variants, found, at, own)) {
            effect |= ACTIVE | FITTING;
        } else if (own->end != NONE || !agree(found->probes + at, own, found->right + k)) {
            effect |= ACTIVE;
        }
    }
    return effect;
}

/* Finds the pairs of mistakes, or with when[1] = 0 the single mistakes, that explain all answers. Returns their number, up to `most`.
 * Each mistake is a list of terms and variants that ends with -1. A pair is tried if both mistakes change answers to the
 * first wrong probes, or if one of them explains such an answer. */
int search(const int when[2], int mistakes, const int *const *terms, const Found *found, Answer *own, int most, int *explaining) {
    int hits = 0;
    char effects[2][mistakes];
    for (int k = 0; k < 2; k++)
        for (int a = 0; a < mistakes; a++)
            effects[k][a] = when[k] ? effectOf(terms[a], when[k], found, own) : 0;
    for (int a = 0; a < mistakes; a++)
        for (int b = when[1] && when[0] == when[1] ? a + 1 : 0; b < (when[1] ? mistakes : 1); b++) {
            Variants variants = {0};
            int one = effects[0][a], other = effects[1][b];
            if (!((one | other) & FITTING) && !(one & other)) continue;
            if (!put(variants, terms[a], when[0]) || !put(variants, terms[b], when[1])) continue;
            if (!explains(variants, found, own)) continue;
            explaining[2 * hits] = a;
            explaining[2 * hits++ + 1] = b;
            if (hits == most) return hits;
        }
    return hits;
}
