#include "fem.h"

#ifndef NOCONTACTITERATE
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    int i, j, iContact;
    int n = myGrains->n;
    double *x = myGrains->x;
    double *y = myGrains->y;
    double *m = myGrains->m;
    double *r = myGrains->r;
    double *vy = myGrains->vy;
    double *vx = myGrains->vx;
    double *dvBoundary = myGrains->dvBoundary;
    double *dvContacts = myGrains->dvContacts;
    double rIn = myGrains->radiusIn;
    double rOut = myGrains->radiusOut;

    double zeta = 0.0;
    iContact = 0;
    for (i = 0; i < n; i++) {
        for (j = i + 1; j < n; j++) {
            double rr = sqrt((x[j] - x[i]) * (x[j] - x[i]) + (y[j] - y[i]) * (y[j] - y[i]));
            double nx = (x[j] - x[i]) / rr;
            double ny = (y[j] - y[i]) / rr;
            double dv;
            if (iter == 0) {
                dv = dvContacts[iContact];
            }
            else {
                double gap = rr - r[i] - r[j];
                double vn = vx[i] * nx + vy[i] * ny - vx[j] * nx - vy[j] * ny;
                dv = fmax(0.0, vn + dvContacts[iContact] - gap / dt) - dvContacts[iContact];
                dvContacts[iContact] += dv;
                zeta = fmax(zeta, fabs(dv));
            }
            vx[i] -= dv * nx * m[j] / (m[i] + m[j]);
            vy[i] -= dv * ny * m[j] / (m[i] + m[j]);
            vx[j] += dv * nx * m[i] / (m[i] + m[j]);
            vy[j] += dv * ny * m[i] / (m[i] + m[j]);
            iContact++;
        }
    }
    for (i = 0; i < n; i++) {
        double rr = sqrt(x[i] * x[i] + y[i] * y[i]);
        double nx = x[i] / rr;
        double ny = y[i] / rr;
        double dv;
        if (iter == 0) {
            dv = dvBoundary[i];
        }
        else {
            double vn = vx[i] * nx + vy[i] * ny;
            double dvOut = fmax(0.0, vn + dvBoundary[i] - (rOut - rr - r[i]) / dt);
            double dvIn = fmax(0.0, -vn - dvBoundary[i] - (rr - rIn - r[i]) / dt);
            dv = dvOut - dvIn - dvBoundary[i];
            dvBoundary[i] += dv;
            zeta = fmax(zeta, fabs(dv));
        }
        vx[i] -= dv * nx;
        vy[i] -= dv * ny;
    }
    return zeta;
}
#endif

#ifndef NOUPDATE
void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    int i, iter = 0;
    int n = myGrains->n;
    double *x = myGrains->x, *y = myGrains->y;
    double *vx = myGrains->vx, *vy = myGrains->vy, *m = myGrains->m;
    double gx = myGrains->gravity[0];
    double gy = myGrains->gravity[1];
    double gamma = myGrains->gamma;
    double zeta;
    for (i = 0; i < n; i++) {
        double fx = m[i] * gx - gamma * vx[i];
        double fy = m[i] * gy - gamma * vy[i];
        vx[i] += fx * dt / m[i];
        vy[i] += fy * dt / m[i];
    }
    do {
        zeta = femGrainsContactIterate(myGrains, dt, iter);
        iter++;
    } while ((zeta > tol && iter <= iterMax) || iter == 1);
    printf("iterations = %4d : error = %14.7e \n", iter - 1, zeta);
    for (i = 0; i < n; ++i) {
        x[i] += vx[i] * dt;
        y[i] += vy[i] * dt;
    }
}
#endif
