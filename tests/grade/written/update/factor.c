void femGrainsUpdate(femGrains *g, double dt, double tol, double iterMax)
{
    for (int i = 0; i < g->n; i++) {
        double keep = 1 - g->gamma * dt / g->m[i];
        g->vx[i] = keep * g->vx[i] + dt * g->gravity[0];
        g->vy[i] = keep * g->vy[i] + dt * g->gravity[1];
    }
    double error = 2 * tol + 1;
    for (int iter = 0; iter < iterMax && error > tol; iter++) {
        error = femGrainsContactIterate(g, dt, iter);
        if (iter == 0) error = 2 * tol + 1;
    }
    for (int i = 0; i < g->n; i++) {
        g->x[i] = g->x[i] + dt * g->vx[i];
        g->y[i] = g->y[i] + dt * g->vy[i];
    }
}
