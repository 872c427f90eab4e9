static long double plus(long double a) { return a > 0 ? a : 0; }
static double worst;
static void record(double change) { if (fabs(change) > worst) worst = fabs(change); }

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    int n = myGrains->n, l = 0;
    worst = 0;
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            long double dx = myGrains->x[j] - myGrains->x[i], dy = myGrains->y[j] - myGrains->y[i];
            long double d = sqrtl(dx * dx + dy * dy), nx = dx / d, ny = dy / d;
            long double vn = nx * (myGrains->vx[i] - myGrains->vx[j]) + ny * (myGrains->vy[i] - myGrains->vy[j]);
            long double dv;
            if (iter == 0) {
                dv = myGrains->dvContacts[l];
            } else {
                dv = plus(vn + myGrains->dvContacts[l] - (d - myGrains->r[i] - myGrains->r[j]) / dt) - myGrains->dvContacts[l];
                record(dv);
                myGrains->dvContacts[l] += dv;
            }
            long double part = myGrains->m[i] / (myGrains->m[i] + myGrains->m[j]);
            myGrains->vx[i] -= (1 - part) * dv * nx;
            myGrains->vx[j] += part * dv * nx;
            myGrains->vy[i] -= (1 - part) * dv * ny;
            myGrains->vy[j] += part * dv * ny;
            l++;
        }
    for (int i = 0; i < n; i++) {
        long double d = sqrtl(myGrains->x[i] * myGrains->x[i] + myGrains->y[i] * myGrains->y[i]);
        long double nx = myGrains->x[i] / d, ny = myGrains->y[i] / d;
        long double vn = nx * myGrains->vx[i] + ny * myGrains->vy[i];
        long double dv;
        if (iter == 0) {
            dv = myGrains->dvBoundary[i];
        } else {
            long double out = plus(vn + myGrains->dvBoundary[i] - (myGrains->radiusOut - d - myGrains->r[i]) / dt);
            long double in = plus(-vn - myGrains->dvBoundary[i] - (d - myGrains->radiusIn - myGrains->r[i]) / dt);
            dv = out - in - myGrains->dvBoundary[i];
            record(dv);
            myGrains->dvBoundary[i] += dv;
        }
        myGrains->vx[i] -= dv * nx;
        myGrains->vy[i] -= dv * ny;
    }
    return worst;
}
