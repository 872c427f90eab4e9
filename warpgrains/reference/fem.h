/* Grains in an annulus: the struct and the functions of the course text. */

#ifndef FEM_H
#define FEM_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    int n;
    double radiusIn, radiusOut, gravity[2], gamma;
    double *x, *y, *vx, *vy, *r, *m, *dvBoundary, *dvContacts;
#ifdef REFERENCE
    int leapfrog, staggered, round; /* not the text's: scheme, whether v is half a step behind, outer wall */
    int nDiscs;                     /* fixed discs inside the annulus: */
    double *discs, *dvDiscs;        /* center and radius of each, and corrections by grain and disc */
#endif
} femGrains;

femGrains *femGrainsCreateSimple(int n, double r, double m, double radiusIn, double radiusOut);
void femGrainsFree(femGrains *myGrains);
void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax);
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter);

#endif
