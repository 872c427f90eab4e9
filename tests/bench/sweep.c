/* The contact iteration of kernels/gauss_seidel.py in C, on the same records: grains of one mass, no inner wall. */

#include <math.h>

typedef struct {
    double x, y;
} Vec;

typedef struct {
    Vec n;
    double gapRate;
    int i, j;
} Contact;

static double larger(double a, double b) { return a > b ? a : b; }

static double sweepPairs(int count, const Contact *restrict contacts, double *restrict dvs,
                         Vec *restrict v) {
    double zeta = 0.0;
    for (int c = 0; c < count; c++) {
        const Contact *p = &contacts[c];
        Vec vi = v[p->i], vj = v[p->j];
        double vn = (vi.x - vj.x) * p->n.x + (vi.y - vj.y) * p->n.y;
        double dv = larger(0.0, vn + dvs[c] - p->gapRate) - dvs[c];
        v[p->i].x = vi.x - dv * p->n.x * 0.5;
        v[p->i].y = vi.y - dv * p->n.y * 0.5;
        v[p->j].x = vj.x + dv * p->n.x * 0.5;
        v[p->j].y = vj.y + dv * p->n.y * 0.5;
        dvs[c] += dv;
        zeta = larger(zeta, fabs(dv));
    }
    return zeta;
}

static double sweepWalls(int count, const Contact *restrict contacts, double *restrict dvs, Vec *restrict v) {
    double zeta = 0.0;
    for (int c = 0; c < count; c++) {
        const Contact *w = &contacts[c];
        Vec *vi = &v[w->i];
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
double sweeps(int count, int nPairs, int nWalls, const Contact *contacts, double *dvs, Vec *velocity) {
    double zeta = 0.0;
    for (int k = 0; k < count; k++) {
        zeta = sweepPairs(nPairs, contacts, dvs, velocity);
        zeta = larger(zeta, sweepWalls(nWalls, contacts + nPairs, dvs + nPairs, velocity));
    }
    return zeta;
}
