double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    double zeta = 0.0;
    int k = 0;
    for (int i = 0; i < myGrains->n; i++) {
        for (int j = i + 1; j < myGrains->n; j++) {
            double dx = myGrains->x[j] - myGrains->x[i];
            double dy = myGrains->y[j] - myGrains->y[i];
            double theta = atan2(dy, dx);
            double nx = cos(theta), ny = sin(theta);
            double gap = dx * nx + dy * ny - myGrains->r[i] - myGrains->r[j];
            double vn = (myGrains->vx[i] - myGrains->vx[j]) * nx + (myGrains->vy[i] - myGrains->vy[j]) * ny;
            double dv = myGrains->dvContacts[k];
            if (iter >= 1)
                dv = fmax(-dv, vn - gap / dt);
            double ratio = myGrains->m[j] / (myGrains->m[i] + myGrains->m[j]);
            myGrains->vx[i] -= dv * ratio * nx;
            myGrains->vy[i] -= dv * ratio * ny;
            myGrains->vx[j] += dv * (1.0 - ratio) * nx;
            myGrains->vy[j] += dv * (1.0 - ratio) * ny;
            if (iter >= 1) {
                myGrains->dvContacts[k] += dv;
                zeta = fmax(zeta, fabs(dv));
            }
            k = k + 1;
        }
    }
    for (int i = 0; i < myGrains->n; i++) {
        double theta = atan2(myGrains->y[i], myGrains->x[i]);
        double nx = cos(theta), ny = sin(theta);
        double d = myGrains->x[i] * nx + myGrains->y[i] * ny;
        double vn = myGrains->vx[i] * nx + myGrains->vy[i] * ny;
        double dv = myGrains->dvBoundary[i];
        if (iter >= 1) {
            double s = vn + dv;
            double highest = (myGrains->radiusOut - d - myGrains->r[i]) / dt;
            double lowest = -(d - myGrains->radiusIn - myGrains->r[i]) / dt;
            double needed = 0.0;
            if (s > highest) needed = s - highest;
            else if (s < lowest) needed = s - lowest;
            dv = needed - dv;
            myGrains->dvBoundary[i] = needed;
            zeta = fmax(zeta, fabs(dv));
        }
        myGrains->vx[i] -= dv * nx;
        myGrains->vy[i] -= dv * ny;
    }
    return zeta;
}
