/* Contacts that are open and carry nothing are passed over. */
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    int n = myGrains->n, index = 0;
    double *x = myGrains->x, *y = myGrains->y, *vx = myGrains->vx, *vy = myGrains->vy;
    double zeta = 0.0, dv, vn, gap, nx, ny, norm;
    for (int i = 0; i < n; i++) {
        for (int j = i + 1; j < n; j++, index++) {
            nx = x[j] - x[i];
            ny = y[j] - y[i];
            norm = sqrt(nx * nx + ny * ny);
            nx = nx / norm;
            ny = ny / norm;
            gap = norm - (myGrains->r[i] + myGrains->r[j]);
            vn = (vx[i] - vx[j]) * nx + (vy[i] - vy[j]) * ny;
            dv = myGrains->dvContacts[index];
            if (iter != 0) {
                double next = vn + dv - gap / dt;
                if (next <= 0 && dv == 0) continue;
                dv = (next > 0 ? next : 0) - dv;
                myGrains->dvContacts[index] += dv;
                if (dv > zeta) zeta = dv;
                if (-dv > zeta) zeta = -dv;
            }
            if (dv == 0) continue;
            double mi = myGrains->m[i], mj = myGrains->m[j], sum = mi + mj;
            vx[i] = vx[i] - dv * nx * mj / sum;
            vy[i] = vy[i] - dv * ny * mj / sum;
            vx[j] = vx[j] + dv * nx * mi / sum;
            vy[j] = vy[j] + dv * ny * mi / sum;
        }
    }
    for (int i = 0; i < n; i++) {
        norm = sqrt(x[i] * x[i] + y[i] * y[i]);
        nx = x[i] / norm;
        ny = y[i] / norm;
        vn = vx[i] * nx + vy[i] * ny;
        dv = myGrains->dvBoundary[i];
        if (iter != 0) {
            double out = vn + dv - (myGrains->radiusOut - norm - myGrains->r[i]) / dt;
            double in = -vn - dv - (norm - myGrains->radiusIn - myGrains->r[i]) / dt;
            if (out <= 0 && in <= 0 && dv == 0) continue;
            dv = (out > 0 ? out : 0) - (in > 0 ? in : 0) - dv;
            myGrains->dvBoundary[i] += dv;
            if (fabs(dv) > zeta) zeta = fabs(dv);
        }
        vx[i] = vx[i] - dv * nx;
        vy[i] = vy[i] - dv * ny;
    }
    return zeta;
}
