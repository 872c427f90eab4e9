#include <math.h>
#include "fem.h"
typedef struct { double x, y; } vector;

static vector direction(double x, double y, double *length) {
    *length = hypot(x, y);
    return (vector){x / *length, y / *length};
}
static double clamp(double v) { return v > 0 ? v : 0; }
void push(femGrains *g, int i, vector n, double dv) { g->vx[i] += dv * n.x; g->vy[i] += dv * n.y; }
double error(double v) { return v; }  /* a name of the C library */

double femGrainsContactIterate(femGrains *g, double dt, int iter) {
    double largest = 0, length;
    for (int j = 1; j < g->n; j++)
        for (int i = 0; i < j; i++) {
            double *kept = &g->dvContacts[i * g->n - i * (i + 1) / 2 + j - i - 1];
            vector n = direction(g->x[i] - g->x[j], g->y[i] - g->y[j], &length);
            double speed = (g->vx[j] - g->vx[i]) * n.x + (g->vy[j] - g->vy[i]) * n.y;
            double wanted = iter ? clamp(speed + *kept - (length - g->r[i] - g->r[j]) / dt) : 2 * *kept;
            double change = wanted - *kept, mass = 1 / (1 / g->m[i] + 1 / g->m[j]);
            push(g, i, n, change * mass / g->m[i]);
            push(g, j, n, -change * mass / g->m[j]);
            if (iter) { *kept = wanted; largest = error(fmax(fabs(change), largest)); }
        }
    for (int i = 0; i < g->n; i++) {
        double kept = g->dvBoundary[i], change = kept;
        vector n = direction(g->x[i], g->y[i], &length);
        if (iter) {
            double speed = kept + g->vx[i] * n.x + g->vy[i] * n.y;
            double outer = speed - (g->radiusOut - length - g->r[i]) / dt;
            double inner = speed + (length - g->radiusIn - g->r[i]) / dt;
            double wanted = outer > 0 ? outer : inner < 0 ? inner : 0;
            if (outer > 0 && inner < 0) wanted = outer + inner;
            change = wanted - kept;
            g->dvBoundary[i] = wanted;
            if (fabs(change) > largest) largest = fabs(change);
        }
        push(g, i, n, -change);
    }
    return largest;
}

void femGrainsUpdate(femGrains *g, double dt, double tol, double iterMax) {
    for (int i = g->n - 1; i >= 0; i--) {
        double keep = 1 - dt * g->gamma / g->m[i];
        g->vx[i] = keep * g->vx[i] + dt * g->gravity[0];
        g->vy[i] = keep * g->vy[i] + dt * g->gravity[1];
    }
    femGrainsContactIterate(g, dt, 0);
    for (int k = 1; k <= iterMax; k++)
        if (femGrainsContactIterate(g, dt, k) < tol) break;
    for (int i = 0; i < g->n; i++) { g->x[i] += dt * g->vx[i]; g->y[i] += dt * g->vy[i]; }
}
