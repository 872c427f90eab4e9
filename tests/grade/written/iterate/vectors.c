typedef struct { double x, y; } vec;

static vec sub(vec a, vec b) { vec c = {a.x - b.x, a.y - b.y}; return c; }
static vec scale(double s, vec a) { vec c = {s * a.x, s * a.y}; return c; }
static double inner(vec a, vec b) { return a.x * b.x + a.y * b.y; }
static vec position(femGrains *g, int i) { vec a = {g->x[i], g->y[i]}; return a; }
static vec velocity(femGrains *g, int i) { vec a = {g->vx[i], g->vy[i]}; return a; }
static void push(femGrains *g, int i, vec dv) { g->vx[i] += dv.x; g->vy[i] += dv.y; }

double femGrainsContactIterate(femGrains *g, double dt, int iter)
{
    double zeta = 0.0;
    double *c = g->dvContacts;
    for (int i = 0; i < g->n; i++) {
        for (int j = i + 1; j < g->n; j++, c++) {
            vec d = sub(position(g, j), position(g, i));
            double r = sqrt(inner(d, d));
            vec n = scale(1 / r, d);
            double gap = r - (g->r[i] + g->r[j]);
            double total = g->m[i] + g->m[j];
            double vn = inner(velocity(g, i), n) - inner(velocity(g, j), n);
            double dv = *c;
            if (iter > 0) {
                dv = fmax(0, vn + *c - gap / dt) - *c;
                *c += dv;
                zeta = fmax(zeta, fabs(dv));
            }
            push(g, i, scale(-dv * g->m[j] / total, n));
            push(g, j, scale(dv * g->m[i] / total, n));
        }
    }
    for (int i = 0; i < g->n; i++) {
        vec d = position(g, i);
        double r = sqrt(inner(d, d));
        vec n = scale(1 / r, d);
        double vn = inner(velocity(g, i), n);
        double *b = g->dvBoundary + i;
        double dv = *b;
        if (iter > 0) {
            double out = fmax(0, vn + *b - (g->radiusOut - r - g->r[i]) / dt);
            double in = fmax(0, -vn - *b - (r - g->radiusIn - g->r[i]) / dt);
            dv = out - in - *b;
            *b += dv;
            zeta = fmax(zeta, fabs(dv));
        }
        push(g, i, scale(-dv, n));
    }
    return zeta;
}
