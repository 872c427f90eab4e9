/* Grains in an annulus: the interface of the course text, and one function more (the last). */

typedef struct {
    int n;
    double radiusIn, radiusOut, gravity[2], gamma;
    double *x, *y, *vx, *vy, *r, *m, *dvBoundary, *dvContacts;
    int leapfrog, staggered, round; /* not the text's: scheme, whether v is half a step behind, outer wall */
} femGrains;

/* A contact of grain i: with grain j > i, or with the walls where j < 0. */
typedef struct {
    int i, j;
} femContact;

femGrains *femGrainsCreateSimple(int n, double r, double m, double radiusIn, double radiusOut);
void femGrainsFree(femGrains *myGrains);
void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax);
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter);

/* femGrainsContactIterate over the given contacts in the given order. */
double femGrainsContactIterateOrder(femGrains *myGrains, double dt, int iter, int nContacts,
                                    const femContact *contacts);
