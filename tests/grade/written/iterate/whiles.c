double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    double zeta = 0;
    int first = 0, second = 1, contact = 0, count = myGrains->n * (myGrains->n - 1) / 2;
    while (contact < count) {
        double *a = &myGrains->vx[first], *b = &myGrains->vx[second];
        double *c = &myGrains->vy[first], *d = &myGrains->vy[second];
        double m1 = myGrains->m[first], m2 = myGrains->m[second];
        double dx = myGrains->x[second] - myGrains->x[first];
        double dy = myGrains->y[second] - myGrains->y[first];
        double distance = sqrt(dx * dx + dy * dy);
        double cosinus = dx / distance, sinus = dy / distance;
        double free = distance - (myGrains->r[first] + myGrains->r[second]);
        double closing = (*a * cosinus + *c * sinus) - (*b * cosinus + *d * sinus);
        double change = fmax(0, closing + myGrains->dvContacts[contact] - free / dt) - myGrains->dvContacts[contact];
        if (!iter) change = myGrains->dvContacts[contact];
        else myGrains->dvContacts[contact] += change;
        *a -= change * cosinus * m2 / (m1 + m2);
        *c -= change * sinus * m2 / (m1 + m2);
        *b += change * cosinus * m1 / (m1 + m2);
        *d += change * sinus * m1 / (m1 + m2);
        if (iter) zeta = fmax(zeta, fabs(change));
        contact++;
        second++;
        if (second == myGrains->n) {
            first++;
            second = first + 1;
        }
    }
    int grain = 0;
    while (grain < myGrains->n) {
        double distance = sqrt(myGrains->x[grain] * myGrains->x[grain] + myGrains->y[grain] * myGrains->y[grain]);
        double cosinus = myGrains->x[grain] / distance, sinus = myGrains->y[grain] / distance;
        double outward = myGrains->vx[grain] * cosinus + myGrains->vy[grain] * sinus;
        double outer = fmax(0, outward + myGrains->dvBoundary[grain] - (myGrains->radiusOut - distance - myGrains->r[grain]) / dt);
        double inner = fmax(0, -outward - myGrains->dvBoundary[grain] - (distance - myGrains->radiusIn - myGrains->r[grain]) / dt);
        double change = outer - inner - myGrains->dvBoundary[grain];
        if (!iter) change = myGrains->dvBoundary[grain];
        else myGrains->dvBoundary[grain] += change;
        myGrains->vx[grain] -= change * cosinus;
        myGrains->vy[grain] -= change * sinus;
        if (iter) zeta = fmax(zeta, fabs(change));
        grain++;
    }
    return zeta;
}
