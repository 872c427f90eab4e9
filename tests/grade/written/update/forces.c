void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    int n = myGrains->n;
    double *m = myGrains->m, *vx = myGrains->vx, *vy = myGrains->vy;
    for (int i = 0; i < n; i++) {
        double fx = m[i] * myGrains->gravity[0] - myGrains->gamma * vx[i];
        double fy = m[i] * myGrains->gravity[1] - myGrains->gamma * vy[i];
        vx[i] += fx * dt / m[i];
        vy[i] += fy * dt / m[i];
    }
    for (int iter = 0; iter < iterMax; iter++) {
        double zeta = femGrainsContactIterate(myGrains, dt, iter);
        if (iter > 0 && zeta <= tol) break;
    }
    for (int i = 0; i < n; i++) {
        myGrains->x[i] += vx[i] * dt;
        myGrains->y[i] += vy[i] * dt;
    }
}
