#define ABS(a) ((a) < 0 ? -(a) : (a))
#define MAX(a, b) ((a) > (b) ? (a) : (b))

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    femGrains g = *myGrains;
    int i, j, k = 0;
    double zeta = 0;
    for (i = 0; i < g.n; i++)
        for (j = i + 1; j < g.n; j++) {
            double rx = g.x[j] - g.x[i], ry = g.y[j] - g.y[i];
            double d = sqrt(rx * rx + ry * ry);
            double mu = g.m[i] * g.m[j] / (g.m[i] + g.m[j]);
            double dv, impulse;
            rx /= d;
            ry /= d;
            if (iter == 0)
                dv = g.dvContacts[k];
            else {
                dv = MAX(0, (g.vx[i] - g.vx[j]) * rx + (g.vy[i] - g.vy[j]) * ry + g.dvContacts[k]
                            - (d - g.r[i] - g.r[j]) / dt) - g.dvContacts[k];
                g.dvContacts[k] += dv;
                zeta = MAX(zeta, ABS(dv));
            }
            impulse = mu * dv;
            g.vx[i] -= impulse / g.m[i] * rx;
            g.vy[i] -= impulse / g.m[i] * ry;
            g.vx[j] += impulse / g.m[j] * rx;
            g.vy[j] += impulse / g.m[j] * ry;
            k++;
        }
    for (i = 0; i < g.n; i++) {
        double d = sqrt(g.x[i] * g.x[i] + g.y[i] * g.y[i]);
        double rx = g.x[i] / d, ry = g.y[i] / d;
        double vn = g.vx[i] * rx + g.vy[i] * ry;
        double dv;
        if (iter == 0)
            dv = g.dvBoundary[i];
        else {
            dv = MAX(0, vn + g.dvBoundary[i] - (g.radiusOut - d - g.r[i]) / dt)
               - MAX(0, -vn - g.dvBoundary[i] - (d - g.radiusIn - g.r[i]) / dt) - g.dvBoundary[i];
            g.dvBoundary[i] += dv;
            zeta = MAX(zeta, ABS(dv));
        }
        g.vx[i] -= dv * rx;
        g.vy[i] -= dv * ry;
    }
    return zeta;
}
