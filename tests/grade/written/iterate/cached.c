/* Normals and distances do not change within a step: computed once, in iteration 0. */
static double *nxPair = NULL, *nyPair = NULL, *gapPair = NULL;

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    int n = myGrains->n, pairs = n * (n - 1) / 2, k = 0;
    double *vx = myGrains->vx, *vy = myGrains->vy, *m = myGrains->m, *r = myGrains->r;
    double zeta = 0;
    if (iter == 0 || nxPair == NULL) {
        nxPair = realloc(nxPair, (pairs + 1) * sizeof(double));
        nyPair = realloc(nyPair, (pairs + 1) * sizeof(double));
        gapPair = realloc(gapPair, (pairs + 1) * sizeof(double));
        for (int i = 0; i < n; i++)
            for (int j = i + 1; j < n; j++, k++) {
                double dx = myGrains->x[j] - myGrains->x[i], dy = myGrains->y[j] - myGrains->y[i];
                double d = sqrt(dx * dx + dy * dy);
                nxPair[k] = dx / d;
                nyPair[k] = dy / d;
                gapPair[k] = d - r[i] - r[j];
            }
    }
    k = 0;
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++, k++) {
            double nx = nxPair[k], ny = nyPair[k], *kept = &myGrains->dvContacts[k];
            double vn = (vx[i] - vx[j]) * nx + (vy[i] - vy[j]) * ny;
            double dv = (iter == 0) ? *kept : fmax(0, vn + *kept - gapPair[k] / dt) - *kept;
            double wi = m[j] / (m[i] + m[j]), wj = m[i] / (m[i] + m[j]);
            vx[i] -= dv * nx * wi;
            vy[i] -= dv * ny * wi;
            vx[j] += dv * nx * wj;
            vy[j] += dv * ny * wj;
            if (iter > 0) {
                *kept += dv;
                zeta = fmax(zeta, fabs(dv));
            }
        }
    for (int i = 0; i < n; i++) {
        double d = sqrt(myGrains->x[i] * myGrains->x[i] + myGrains->y[i] * myGrains->y[i]);
        double nx = myGrains->x[i] / d, ny = myGrains->y[i] / d, *kept = &myGrains->dvBoundary[i];
        double vn = vx[i] * nx + vy[i] * ny;
        double out = fmax(0, vn + *kept - (myGrains->radiusOut - d - r[i]) / dt);
        double in = fmax(0, -vn - *kept - (d - myGrains->radiusIn - r[i]) / dt);
        double dv = (iter == 0) ? *kept : out - in - *kept;
        vx[i] -= dv * nx;
        vy[i] -= dv * ny;
        if (iter > 0) {
            *kept += dv;
            zeta = fmax(zeta, fabs(dv));
        }
    }
    return zeta;
}
