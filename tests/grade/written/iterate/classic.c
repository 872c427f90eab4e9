double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    int i, j, iContact = 0;
    int n = myGrains->n;
    double *x = myGrains->x, *y = myGrains->y;
    double *vx = myGrains->vx, *vy = myGrains->vy;
    double *m = myGrains->m, *r = myGrains->r;
    double *dvBoundary = myGrains->dvBoundary, *dvContacts = myGrains->dvContacts;
    double rIn = myGrains->radiusIn, rOut = myGrains->radiusOut;
    double zeta = 0.0;

    for (i = 0; i < n; i++) {
        for (j = i + 1; j < n; j++) {
            double rx = x[j] - x[i];
            double ry = y[j] - y[i];
            double d = sqrt(rx * rx + ry * ry);
            double nx = rx / d;
            double ny = ry / d;
            double vn = vx[i] * nx + vy[i] * ny - vx[j] * nx - vy[j] * ny;
            double gap = d - (r[i] + r[j]);
            double dv = fmax(0.0, vn + dvContacts[iContact] - gap / dt) - dvContacts[iContact];
            if (iter == 0) dv = dvContacts[iContact];
            vx[i] -= dv * nx * m[j] / (m[i] + m[j]);
            vy[i] -= dv * ny * m[j] / (m[i] + m[j]);
            vx[j] += dv * nx * m[i] / (m[i] + m[j]);
            vy[j] += dv * ny * m[i] / (m[i] + m[j]);
            if (iter != 0) {
                dvContacts[iContact] += dv;
                zeta = fmax(zeta, fabs(dv));
            }
            iContact++;
        }
    }
    for (i = 0; i < n; i++) {
        double d = sqrt(x[i] * x[i] + y[i] * y[i]);
        double nx = x[i] / d;
        double ny = y[i] / d;
        double vn = vx[i] * nx + vy[i] * ny;
        double dvOut = fmax(0.0, vn + dvBoundary[i] - (rOut - d - r[i]) / dt);
        double dvIn = fmax(0.0, -vn - dvBoundary[i] - (d - rIn - r[i]) / dt);
        double dv = dvOut - dvIn - dvBoundary[i];
        if (iter == 0) dv = dvBoundary[i];
        vx[i] -= dv * nx;
        vy[i] -= dv * ny;
        if (iter != 0) {
            dvBoundary[i] += dv;
            zeta = fmax(zeta, fabs(dv));
        }
    }
    return zeta;
}
