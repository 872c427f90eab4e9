#include <complex.h>
/* Vectors as complex numbers; prints what it does. */
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    femGrains *g = myGrains;
    double zeta = 0.0;
    int c = 0;
    if (iter == 0) printf("new step, %d grains\n", g->n);
    for (int i = 0; i < g->n; i++)
        for (int j = i + 1; j < g->n; j++, c++) {
            double complex r = (g->x[j] - g->x[i]) + I * (g->y[j] - g->y[i]);
            double complex n = r / cabs(r);
            double complex v = (g->vx[i] - g->vx[j]) + I * (g->vy[i] - g->vy[j]);
            double vn = creal(v * conj(n));
            double kept = g->dvContacts[c];
            double dv = kept;
            if (iter) {
                dv = fmax(0, vn + kept - (cabs(r) - g->r[i] - g->r[j]) / dt) - kept;
                g->dvContacts[c] = kept + dv;
                zeta = fmax(zeta, fabs(dv));
            }
            double complex push = dv * n / (g->m[i] + g->m[j]);
            g->vx[i] -= g->m[j] * creal(push);
            g->vy[i] -= g->m[j] * cimag(push);
            g->vx[j] += g->m[i] * creal(push);
            g->vy[j] += g->m[i] * cimag(push);
        }
    for (int i = 0; i < g->n; i++) {
        double complex r = g->x[i] + I * g->y[i];
        double complex n = r / cabs(r);
        double vn = g->vx[i] * creal(n) + g->vy[i] * cimag(n);
        double kept = g->dvBoundary[i];
        double dv = kept;
        if (iter) {
            double out = fmax(0, vn + kept - (g->radiusOut - cabs(r) - g->r[i]) / dt);
            double in = fmax(0, -vn - kept - (cabs(r) - g->radiusIn - g->r[i]) / dt);
            dv = out - in - kept;
            g->dvBoundary[i] = kept + dv;
            zeta = fmax(zeta, fabs(dv));
        }
        g->vx[i] -= dv * creal(n);
        g->vy[i] -= dv * cimag(n);
    }
    if (iter) printf("iteration %d: zeta = %g\n", iter, zeta);
    return zeta;
}
