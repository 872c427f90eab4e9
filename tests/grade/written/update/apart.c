static void newton(femGrains *g, double dt)
{
    for (int i = 0; i < g->n; i++) {
        double drag = g->gamma / g->m[i];
        g->vx[i] += (g->gravity[0] - drag * g->vx[i]) * dt;
        g->vy[i] += (g->gravity[1] - drag * g->vy[i]) * dt;
    }
}

static void iterations(femGrains *g, double dt, double tol, double iterMax)
{
    femGrainsContactIterate(g, dt, 0);
    for (int iter = 1; iter < iterMax; iter++)
        if (femGrainsContactIterate(g, dt, iter) <= tol) return;
}

static void move(femGrains *g, double dt)
{
    for (int i = 0; i < g->n; i++) {
        g->x[i] += g->vx[i] * dt;
        g->y[i] += g->vy[i] * dt;
    }
}

void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    newton(myGrains, dt);
    iterations(myGrains, dt, tol, iterMax);
    move(myGrains, dt);
}
