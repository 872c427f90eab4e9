void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    double *x = myGrains->x, *y = myGrains->y, *u = myGrains->vx, *v = myGrains->vy;
    int i, iter = 0;
    for (i = 0; i < myGrains->n; i++)
        u[i] += dt * (myGrains->gravity[0] - u[i] * myGrains->gamma / myGrains->m[i]);
    for (i = 0; i < myGrains->n; i++)
        v[i] += dt * (myGrains->gravity[1] - v[i] * myGrains->gamma / myGrains->m[i]);
    while (1) {
        double zeta = femGrainsContactIterate(myGrains, dt, iter++);
        if (iter >= iterMax) break;
        if (iter > 1 && !(zeta > tol)) break;
    }
    for (i = 0; i < myGrains->n; i++) {
        x[i] += dt * u[i];
        y[i] += dt * v[i];
    }
}
