/* One function treats a contact of any kind: i with j, or with a wall if j < 0. */
static double contact(femGrains *g, int i, int j, double *kept, double dt, int iter)
{
    double ax = j < 0 ? 0 : g->x[i], ay = j < 0 ? 0 : g->y[i];
    double bx = j < 0 ? g->x[i] : g->x[j], by = j < 0 ? g->y[i] : g->y[j];
    double d = sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay));
    double nx = (bx - ax) / d, ny = (by - ay) / d;
    double vn = g->vx[i] * nx + g->vy[i] * ny, wi = 1, dv = *kept;
    if (j >= 0) {
        vn -= g->vx[j] * nx + g->vy[j] * ny;
        wi = g->m[j] / (g->m[i] + g->m[j]);
    }
    if (iter != 0) {
        if (j >= 0)
            dv = fmax(0, vn + *kept - (d - g->r[i] - g->r[j]) / dt) - *kept;
        else
            dv = fmax(0, vn + *kept - (g->radiusOut - d - g->r[i]) / dt)
               - fmax(0, -vn - *kept - (d - g->radiusIn - g->r[i]) / dt) - *kept;
        *kept += dv;
    }
    g->vx[i] -= dv * nx * wi;
    g->vy[i] -= dv * ny * wi;
    if (j >= 0) {
        g->vx[j] += dv * nx * (1 - wi);
        g->vy[j] += dv * ny * (1 - wi);
    }
    return iter == 0 ? 0 : fabs(dv);
}

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    double zeta = 0;
    int k = 0;
    for (int i = 0; i < myGrains->n; i++)
        for (int j = i + 1; j < myGrains->n; j++)
            zeta = fmax(zeta, contact(myGrains, i, j, &myGrains->dvContacts[k++], dt, iter));
    for (int i = 0; i < myGrains->n; i++)
        zeta = fmax(zeta, contact(myGrains, i, -1, &myGrains->dvBoundary[i], dt, iter));
    return zeta;
}
