void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    int i, n = myGrains->n, iter = 0;
    double zeta;
    for (i = 0; i < n; i++) {
        double ax = myGrains->gravity[0] - myGrains->gamma * myGrains->vx[i] / myGrains->m[i];
        double ay = myGrains->gravity[1] - myGrains->gamma * myGrains->vy[i] / myGrains->m[i];
        myGrains->vx[i] += dt * ax;
        myGrains->vy[i] += dt * ay;
    }
    do {
        zeta = femGrainsContactIterate(myGrains, dt, iter);
        iter++;
    } while ((zeta > tol || iter == 1) && iter < iterMax);
    for (i = 0; i < n; i++) {
        myGrains->x[i] += dt * myGrains->vx[i];
        myGrains->y[i] += dt * myGrains->vy[i];
    }
}
