/* The contact iteration of kernels/sweeps/pair_sweep.py in C, on the same records: grains of one mass, no inner wall;
   and many steps of the reference, so that nothing but C is timed. */

#include <math.h>

#include "grains.h"

void run(femGrains *grains, int steps, double dt, double tol, double iterMax) {
    for (int k = 0; k < steps; k++) femGrainsUpdate(grains, dt, tol, iterMax);
}

typedef struct {
    double x, y;
} Vec;

typedef struct {
    Vec n;
    double gapRate;
    unsigned i, j; /* 2 i and 2 j: where velocities begin in an array of numbers */
} Contact;

static double larger(double a, double b) { return a > b ? a : b; }

static double sweepPairs(int count, const Contact *restrict contacts, double *restrict dvs,
                         double *restrict v) {
    double zeta = 0.0;
    for (int c = 0; c < count; c++) {
        const Contact *p = &contacts[c];
        Vec *pi = (Vec *)(v + p->i), *pj = (Vec *)(v + p->j), vi = *pi, vj = *pj;
        double vn = (vi.x - vj.x) * p->n.x + (vi.y - vj.y) * p->n.y;
        double dv = larger(0.0, vn + dvs[c] - p->gapRate) - dvs[c];
        pi->x = vi.x - dv * p->n.x * 0.5;
        pi->y = vi.y - dv * p->n.y * 0.5;
        pj->x = vj.x + dv * p->n.x * 0.5;
        pj->y = vj.y + dv * p->n.y * 0.5;
        dvs[c] += dv;
        zeta = larger(zeta, fabs(dv));
    }
    return zeta;
}

static double sweepWalls(int count, const Contact *restrict contacts, double *restrict dvs, double *restrict v) {
    double zeta = 0.0;
    for (int c = 0; c < count; c++) {
        const Contact *w = &contacts[c];
        Vec *vi = (Vec *)(v + w->i);
        double vn = vi->x * w->n.x + vi->y * w->n.y;
        double dv = larger(0.0, vn + dvs[c] - w->gapRate) - dvs[c];
        vi->x -= dv * w->n.x;
        vi->y -= dv * w->n.y;
        dvs[c] += dv;
        zeta = larger(zeta, fabs(dv));
    }
    return zeta;
}

/* Sweep `count` times over pairs, then contacts with walls; returns the zeta of the last sweep. */
double sweeps(int count, int nPairs, int nWalls, const Contact *contacts, double *dvs, double *velocity) {
    double zeta = 0.0;
    for (int k = 0; k < count; k++) {
        zeta = sweepPairs(nPairs, contacts, dvs, velocity);
        zeta = larger(zeta, sweepWalls(nWalls, contacts + nPairs, dvs + nPairs, velocity));
    }
    return zeta;
}
