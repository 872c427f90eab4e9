static double maximum(double a, double b) { return a > b ? a : b; }

static double dot(double ax, double ay, double bx, double by) { return ax * bx + ay * by; }

static double pairCorrection(femGrains *g, int i, int j, int k, double dt, double nx, double ny, double distance)
{
    double gamma = distance - (g->r[i] + g->r[j]);
    double vn = dot(g->vx[i], g->vy[i], nx, ny) - dot(g->vx[j], g->vy[j], nx, ny);
    return maximum(0, vn + g->dvContacts[k] - gamma / dt) - g->dvContacts[k];
}

static double wallCorrection(femGrains *g, int i, double dt, double nx, double ny, double distance)
{
    double vn = dot(g->vx[i], g->vy[i], nx, ny);
    double gammaOut = (g->radiusOut - distance - g->r[i]) / dt;
    double gammaIn = (distance - g->radiusIn - g->r[i]) / dt;
    double out = maximum(0, vn + g->dvBoundary[i] - gammaOut);
    double in = maximum(0, -vn - g->dvBoundary[i] - gammaIn);
    return out - in - g->dvBoundary[i];
}

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    femGrains *g = myGrains;
    double zeta = 0;
    int k = 0;
    for (int i = 0; i < g->n; ++i)
        for (int j = i + 1; j < g->n; ++j, ++k) {
            double dx = g->x[j] - g->x[i], dy = g->y[j] - g->y[i];
            double distance = sqrt(dot(dx, dy, dx, dy));
            double nx = dx / distance, ny = dy / distance;
            double dv = iter == 0 ? g->dvContacts[k] : pairCorrection(g, i, j, k, dt, nx, ny, distance);
            double share = g->m[j] / (g->m[i] + g->m[j]);
            g->vx[i] -= share * dv * nx;
            g->vy[i] -= share * dv * ny;
            g->vx[j] += (1 - share) * dv * nx;
            g->vy[j] += (1 - share) * dv * ny;
            if (iter) {
                g->dvContacts[k] += dv;
                zeta = maximum(zeta, fabs(dv));
            }
        }
    for (int i = 0; i < g->n; ++i) {
        double distance = sqrt(dot(g->x[i], g->y[i], g->x[i], g->y[i]));
        double nx = g->x[i] / distance, ny = g->y[i] / distance;
        double dv = iter == 0 ? g->dvBoundary[i] : wallCorrection(g, i, dt, nx, ny, distance);
        g->vx[i] -= dv * nx;
        g->vy[i] -= dv * ny;
        if (iter) {
            g->dvBoundary[i] += dv;
            zeta = maximum(zeta, fabs(dv));
        }
    }
    return zeta;
}
