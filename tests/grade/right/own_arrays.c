#include <fem.h>
#define SQUARE(a) ((a) * (a))

#ifndef NOUPDATE
void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    int n = myGrains->n, k;
    double *ax = malloc(n * sizeof(double)), *ay = calloc(n, sizeof(double));
    for (k = 0; k < n; k++) {
        ax[k] = myGrains->gravity[0] - myGrains->gamma / myGrains->m[k] * myGrains->vx[k];
        ay[k] = myGrains->gravity[1] - myGrains->gamma / myGrains->m[k] * myGrains->vy[k];
    }
    for (k = 0; k < n; k++) { myGrains->vx[k] += ax[k] * dt; myGrains->vy[k] += ay[k] * dt; }
    free(ax); free(ay);
    double error = tol + 1.0;
    for (k = 0; (error > tol && k < iterMax) || k < 2; k++)   /* iteration 0 counts */
        error = femGrainsContactIterate(myGrains, dt, k) + (k == 0 ? tol + 1.0 : 0.0);
    for (k = 0; k < n; k++) { myGrains->x[k] += myGrains->vx[k] * dt; myGrains->y[k] += myGrains->vy[k] * dt; }
}
#endif
#ifndef NOCONTACTITERATE
static double oneWall(femGrains *g, int k, double dt) {
    double r = sqrt(SQUARE(g->x[k]) + SQUARE(g->y[k]));
    double u = (g->vx[k] * g->x[k] + g->vy[k] * g->y[k]) / r + g->dvBoundary[k];
    double out = fmax(0, u - (g->radiusOut - r - g->r[k]) / dt), in = fmax(0, -u - (r - g->radiusIn - g->r[k]) / dt);
    return out - in - g->dvBoundary[k];
}
double femGrainsContactIterate(femGrains *g, double dt, int iter)
{
    int n = g->n, i, j;
    double zeta = 0, *dvc = g->dvContacts;
    double (*v)[2] = malloc(n * sizeof *v);
    for (i = 0; i < n; i++) v[i][0] = g->vx[i], v[i][1] = g->vy[i];
    for (i = 0; i < n - 1; i++)
        for (j = i + 1; j < n; j++, dvc++) {
            double dx = g->x[j] - g->x[i], dy = g->y[j] - g->y[i], d2 = SQUARE(dx) + SQUARE(dy), d = sqrt(d2);
            double approach = ((v[i][0] - v[j][0]) * dx + (v[i][1] - v[j][1]) * dy) / d;
            double dv = -*dvc;
            double closing = approach + *dvc - (d - (g->r[i] + g->r[j])) / dt;
            if (iter == 0) dv = *dvc;
            else if (closing > 0) dv += closing;
            if (iter > 0) *dvc += dv;
            if (iter > 0 && fabs(dv) > zeta) zeta = fabs(dv);
            double impulse = dv / d * g->m[i] * g->m[j] / (g->m[i] + g->m[j]);
            v[i][0] -= impulse / g->m[i] * dx, v[i][1] -= impulse / g->m[i] * dy;
            v[j][0] += impulse / g->m[j] * dx, v[j][1] += impulse / g->m[j] * dy;
        }
    for (i = 0; i < n; i++) g->vx[i] = v[i][0], g->vy[i] = v[i][1];
    free(v);
    for (i = 0; i < n; i++) {
        double dv = iter == 0 ? g->dvBoundary[i] : oneWall(g, i, dt), r = sqrt(SQUARE(g->x[i]) + SQUARE(g->y[i]));
        g->vx[i] -= dv * g->x[i] / r; g->vy[i] -= dv * g->y[i] / r;
        if (iter != 0) { g->dvBoundary[i] += dv; zeta = fabs(dv) > zeta ? fabs(dv) : zeta; }
    }
    return zeta;
}
#endif
