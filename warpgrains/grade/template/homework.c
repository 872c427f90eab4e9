#include "fem.h"

/* Keep the lines #ifndef and #endif: by them each function is tested alone. */

#ifndef NOCONTACTITERATE

double femGrainsContactIterate(femGrains *myGrains, double dt, int iter)
{
    double zeta = 0.0;

    /* To be written: every pair i < j, then every grain at the two walls. */

    return zeta;
}

#endif
#ifndef NOUPDATE

void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax)
{
    int n = myGrains->n;

    /* To be written: 1. the velocities, by Newton's law; 2. the iterations. */

    /* 3. The positions, by the corrected velocities. */
    for (int i = 0; i < n; i++) {
        myGrains->x[i] += dt * myGrains->vx[i];
        myGrains->y[i] += dt * myGrains->vy[i];
    }
}

#endif
