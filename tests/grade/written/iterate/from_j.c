/* The normal points from j to i, and every sign follows. */
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    double *x = myGrains->x, *y = myGrains->y, *u = myGrains->vx, *v = myGrains->vy;
    double *m = myGrains->m, *r = myGrains->r, *c = myGrains->dvContacts, *b = myGrains->dvBoundary;
    int n = myGrains->n, i, j, k;
    double zeta = 0.0;
    for (i = k = 0; i < n; i++) {
        for (j = i + 1; j < n; j++, k++) {
            double X = x[i] - x[j], Y = y[i] - y[j];
            double L = sqrt(X * X + Y * Y);
            X /= L;
            Y /= L;
            double approach = (u[j] - u[i]) * X + (v[j] - v[i]) * Y;
            double old = c[k];
            double now = iter == 0 ? 2 * old : fmax(0., approach + old - (L - r[i] - r[j]) / dt);
            double p = (now - old) / (1 / m[i] + 1 / m[j]);
            u[i] += p * X / m[i];
            v[i] += p * Y / m[i];
            u[j] -= p * X / m[j];
            v[j] -= p * Y / m[j];
            if (iter == 0) continue;
            c[k] = now;
            zeta = fmax(zeta, fabs(now - old));
        }
    }
    for (i = 0; i < n; i++) {
        double L = sqrt(x[i] * x[i] + y[i] * y[i]);
        double X = -x[i] / L, Y = -y[i] / L;
        double approach = u[i] * X + v[i] * Y;
        double dv = b[i];
        if (iter != 0) {
            double out = fmax(0., -approach + b[i] - (myGrains->radiusOut - L - r[i]) / dt);
            double in = fmax(0., approach - b[i] - (L - myGrains->radiusIn - r[i]) / dt);
            dv = out - in - b[i];
            b[i] += dv;
            zeta = fmax(zeta, fabs(dv));
        }
        u[i] += dv * X;
        v[i] += dv * Y;
    }
    return zeta;
}
