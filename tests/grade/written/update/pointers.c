static int more(double zeta, double tol, int done, double most)
{
    if (done >= most) return 0;
    return done < 2 || zeta > tol;
}

void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    double *end = myGrains->vx + myGrains->n, *m = myGrains->m, *vy = myGrains->vy;
    for (double *vx = myGrains->vx; vx < end; vx++, vy++, m++) {
        *vx -= dt * myGrains->gamma * *vx / *m;
        *vx += dt * myGrains->gravity[0];
        *vy -= dt * myGrains->gamma * *vy / *m;
        *vy += dt * myGrains->gravity[1];
    }
    int done = 0;
    double zeta = 0;
    while (more(zeta, tol, done, iterMax)) {
        zeta = femGrainsContactIterate(myGrains, dt, done);
        done++;
    }
    for (int i = myGrains->n - 1; i >= 0; i--) {
        myGrains->x[i] += myGrains->vx[i] * dt;
        myGrains->y[i] += myGrains->vy[i] * dt;
    }
}
