/* The place of the pair (i, j) among the contacts. */
int numberOf(int n, int i, int j)
{
    return i * n - i * (i + 1) / 2 + (j - i - 1);
}

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    const int n = myGrains->n;
    double error = 0.0;
    int i, j;

    for (i = 0; i < n - 1; i++) {
        for (j = i + 1; j < n; j++) {
            const int number = numberOf(n, i, j);
            const double ex = myGrains->x[j] - myGrains->x[i];
            const double ey = myGrains->y[j] - myGrains->y[i];
            const double length = hypot(ex, ey);
            const double ux = ex / length, uy = ey / length;
            const double mi = myGrains->m[i], mj = myGrains->m[j];
            const double gap = length - myGrains->r[i] - myGrains->r[j];
            double correction;
            if (iter == 0) {
                correction = myGrains->dvContacts[number];
            } else {
                double closing = (myGrains->vx[i] - myGrains->vx[j]) * ux + (myGrains->vy[i] - myGrains->vy[j]) * uy;
                double wanted = closing + myGrains->dvContacts[number] - gap / dt;
                if (wanted < 0) wanted = 0;
                correction = wanted - myGrains->dvContacts[number];
                myGrains->dvContacts[number] = wanted;
                if (fabs(correction) > error) error = fabs(correction);
            }
            myGrains->vx[i] -= correction * ux * mj / (mi + mj);
            myGrains->vy[i] -= correction * uy * mj / (mi + mj);
            myGrains->vx[j] += correction * ux * mi / (mi + mj);
            myGrains->vy[j] += correction * uy * mi / (mi + mj);
        }
    }
    for (i = 0; i < n; i++) {
        const double length = hypot(myGrains->x[i], myGrains->y[i]);
        const double ux = myGrains->x[i] / length, uy = myGrains->y[i] / length;
        double correction;
        if (iter == 0) {
            correction = myGrains->dvBoundary[i];
        } else {
            double speed = myGrains->vx[i] * ux + myGrains->vy[i] * uy + myGrains->dvBoundary[i];
            double outside = speed - (myGrains->radiusOut - length - myGrains->r[i]) / dt;
            double inside = -speed - (length - myGrains->radiusIn - myGrains->r[i]) / dt;
            double wanted = 0;
            if (outside > 0) wanted += outside;
            if (inside > 0) wanted -= inside;
            correction = wanted - myGrains->dvBoundary[i];
            myGrains->dvBoundary[i] = wanted;
            if (fabs(correction) > error) error = fabs(correction);
        }
        myGrains->vx[i] -= correction * ux;
        myGrains->vy[i] -= correction * uy;
    }
    return error;
}
