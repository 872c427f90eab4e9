void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    int n = myGrains->n, iter;
    double *acceleration = malloc(2 * n * sizeof(double));
    for (int i = 0; i < n; i++) {
        acceleration[2 * i] = myGrains->gravity[0] - myGrains->vx[i] * myGrains->gamma / myGrains->m[i];
        acceleration[2 * i + 1] = myGrains->gravity[1] - myGrains->vy[i] * myGrains->gamma / myGrains->m[i];
    }
    for (int i = 0; i < n; i++) {
        myGrains->vx[i] += acceleration[2 * i] * dt;
        myGrains->vy[i] += acceleration[2 * i + 1] * dt;
    }
    free(acceleration);
    double zeta = HUGE_VAL;
    for (iter = 0; iter < iterMax && (iter < 2 || zeta > tol); iter++)
        zeta = femGrainsContactIterate(myGrains, dt, iter);
    printf("iterations : %d, zeta = %e\n", iter, zeta);
    for (int i = 0; i < n; i++) {
        myGrains->x[i] += myGrains->vx[i] * dt;
        myGrains->y[i] += myGrains->vy[i] * dt;
    }
}
