/* Iteration 0 apart from the others. */
static void demarrage(femGrains *G)
{
    int k = 0;
    for (int i = 0; i < G->n; i++)
        for (int j = i + 1; j < G->n; j++) {
            double dx = G->x[j] - G->x[i], dy = G->y[j] - G->y[i], d = sqrt(dx*dx + dy*dy);
            double a = G->dvContacts[k++] / (G->m[i] + G->m[j]) / d;
            G->vx[i] -= a * dx * G->m[j];
            G->vy[i] -= a * dy * G->m[j];
            G->vx[j] += a * dx * G->m[i];
            G->vy[j] += a * dy * G->m[i];
        }
    for (int i = 0; i < G->n; i++) {
        double d = sqrt(G->x[i]*G->x[i] + G->y[i]*G->y[i]);
        G->vx[i] -= G->dvBoundary[i] * G->x[i] / d;
        G->vy[i] -= G->dvBoundary[i] * G->y[i] / d;
    }
}

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    femGrains *G = myGrains;
    double zeta = 0, dv;
    int i, j, k = 0;
    if (iter == 0) {
        demarrage(G);
        return 1.0;
    }
    for (i = 0; i < G->n; i++) {
        for (j = i + 1; j < G->n; j++) {
            double dx = G->x[j] - G->x[i], dy = G->y[j] - G->y[i], d = sqrt(dx*dx + dy*dy);
            double ecart = d - (G->r[i] + G->r[j]);
            double vn = (G->vx[i]*dx + G->vy[i]*dy - G->vx[j]*dx - G->vy[j]*dy) / d;
            double valeur = vn + G->dvContacts[k] - ecart/dt;
            dv = (valeur > 0 ? valeur : 0) - G->dvContacts[k];
            G->vx[i] -= dv * dx/d * G->m[j]/(G->m[i] + G->m[j]);
            G->vy[i] -= dv * dy/d * G->m[j]/(G->m[i] + G->m[j]);
            G->vx[j] += dv * dx/d * G->m[i]/(G->m[i] + G->m[j]);
            G->vy[j] += dv * dy/d * G->m[i]/(G->m[i] + G->m[j]);
            G->dvContacts[k] += dv;
            if (fabs(dv) > zeta) zeta = fabs(dv);
            k++;
        }
    }
    for (i = 0; i < G->n; i++) {
        double d = sqrt(G->x[i]*G->x[i] + G->y[i]*G->y[i]);
        double nx = G->x[i]/d, ny = G->y[i]/d;
        double vn = G->vx[i]*nx + G->vy[i]*ny;
        double dehors = vn + G->dvBoundary[i] - (G->radiusOut - d - G->r[i])/dt;
        double dedans = -vn - G->dvBoundary[i] - (d - G->radiusIn - G->r[i])/dt;
        dv = (dehors > 0 ? dehors : 0) - (dedans > 0 ? dedans : 0) - G->dvBoundary[i];
        G->vx[i] -= dv*nx;
        G->vy[i] -= dv*ny;
        G->dvBoundary[i] += dv;
        if (fabs(dv) > zeta) zeta = fabs(dv);
    }
    return zeta;
}
