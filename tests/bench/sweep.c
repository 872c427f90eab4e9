/* The contact iteration of kernels/gauss_seidel.py in C, on the same records: grains of one mass, no inner wall. */

#include <math.h>

typedef struct {
    double x, y;
} Vec;

typedef struct {
    Vec n;
    double gapRate;
    int i, j;
} Pair;

typedef struct {
    Vec n;
    double gapRateOut, gapRateIn, reach, dv;
    int i;
} Wall;

static double larger(double a, double b) { return a > b ? a : b; }

static double sweepPairs(int count, const Pair *restrict pairs, double *restrict pairDv, Vec *restrict v) {
    double zeta = 0.0;
    for (int c = 0; c < count; c++) {
        const Pair *p = &pairs[c];
        Vec vi = v[p->i], vj = v[p->j];
        double vn = (vi.x - vj.x) * p->n.x + (vi.y - vj.y) * p->n.y;
        double dv = larger(0.0, vn + pairDv[c] - p->gapRate) - pairDv[c];
        v[p->i].x = vi.x - dv * p->n.x * 0.5;
        v[p->i].y = vi.y - dv * p->n.y * 0.5;
        v[p->j].x = vj.x + dv * p->n.x * 0.5;
        v[p->j].y = vj.y + dv * p->n.y * 0.5;
        pairDv[c] += dv;
        zeta = larger(zeta, fabs(dv));
    }
    return zeta;
}

static double sweepWalls(int count, Wall *restrict walls, Vec *restrict v) {
    double zeta = 0.0;
    for (int c = 0; c < count; c++) {
        Wall *w = &walls[c];
        Vec *vi = &v[w->i];
        double vn = vi->x * w->n.x + vi->y * w->n.y;
        double dv = larger(0.0, vn + w->dv - w->gapRateOut) - w->dv;
        vi->x -= dv * w->n.x;
        vi->y -= dv * w->n.y;
        w->dv += dv;
        zeta = larger(zeta, fabs(dv));
    }
    return zeta;
}

/* So many sweeps; returns the zeta of the last. */
double sweeps(int count, int nPairs, const Pair *pairs, double *pairDv, int nWalls, Wall *walls,
              Vec *velocity) {
    double zeta = 0.0;
    for (int k = 0; k < count; k++) {
        zeta = sweepPairs(nPairs, pairs, pairDv, velocity);
        zeta = larger(zeta, sweepWalls(nWalls, walls, velocity));
    }
    return zeta;
}
