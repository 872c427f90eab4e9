/* Copies the velocities into arrays of its own and writes them back at the end. */
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    int n = myGrains->n, q = 0;
    double v[n][2], p[n][2], zeta = 0;
    for (int i = 0; i < n; i++) {
        v[i][0] = myGrains->vx[i];
        v[i][1] = myGrains->vy[i];
        p[i][0] = myGrains->x[i];
        p[i][1] = myGrains->y[i];
    }
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            double normal[2], vn = 0, d2 = 0, delta;
            for (int a = 0; a < 2; a++) {
                normal[a] = p[j][a] - p[i][a];
                d2 += normal[a] * normal[a];
            }
            for (int a = 0; a < 2; a++) {
                normal[a] /= sqrt(d2);
                vn += (v[i][a] - v[j][a]) * normal[a];
            }
            delta = myGrains->dvContacts[q];
            if (iter != 0) {
                double gap = sqrt(d2) - (myGrains->r[i] + myGrains->r[j]);
                delta = fmax(0, vn + delta - gap / dt) - delta;
                myGrains->dvContacts[q] += delta;
                zeta = fmax(zeta, fabs(delta));
            }
            for (int a = 0; a < 2; a++) {
                v[i][a] -= delta * normal[a] * myGrains->m[j] / (myGrains->m[i] + myGrains->m[j]);
                v[j][a] += delta * normal[a] * myGrains->m[i] / (myGrains->m[i] + myGrains->m[j]);
            }
            q++;
        }
    for (int i = 0; i < n; i++) {
        double d = sqrt(p[i][0] * p[i][0] + p[i][1] * p[i][1]);
        double normal[2] = {p[i][0] / d, p[i][1] / d};
        double vn = v[i][0] * normal[0] + v[i][1] * normal[1];
        double delta = myGrains->dvBoundary[i];
        if (iter != 0) {
            double gapOut = (myGrains->radiusOut - d - myGrains->r[i]) / dt;
            double gapIn = (d - myGrains->radiusIn - myGrains->r[i]) / dt;
            double deltaOut = fmax(0, vn + delta - gapOut);
            double deltaIn = fmax(0, -vn - delta - gapIn);
            delta = deltaOut - deltaIn - delta;
            myGrains->dvBoundary[i] += delta;
            zeta = fmax(zeta, fabs(delta));
        }
        for (int a = 0; a < 2; a++) v[i][a] -= delta * normal[a];
    }
    for (int i = 0; i < n; i++) {
        myGrains->vx[i] = v[i][0];
        myGrains->vy[i] = v[i][1];
    }
    return zeta;
}
