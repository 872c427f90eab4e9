void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    double gx = myGrains->gravity[0], gy = myGrains->gravity[1], gamma = myGrains->gamma;
    double *vx = myGrains->vx, *vy = myGrains->vy, *m = myGrains->m;
    int iter = 0, converged = 0;
    for (int i = 0; i < myGrains->n; i++) {
        vx[i] = vx[i] + dt / m[i] * (m[i] * gx - gamma * vx[i]);
        vy[i] = vy[i] + dt / m[i] * (m[i] * gy - gamma * vy[i]);
    }
    while (!converged && iter < iterMax) {
        double error = femGrainsContactIterate(myGrains, dt, iter);
        converged = error <= tol && iter != 0;
        iter = iter + 1;
    }
    for (int i = 0; i < myGrains->n; i++) {
        myGrains->x[i] += dt * vx[i];
        myGrains->y[i] += dt * vy[i];
    }
}
