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
    int nWalls;                     /* walls inside the annulus: */
    double *walls, *dvWalls;        /* SHAPE numbers of each, and corrections by grain and wall */
    int *jointStart, *joints;       /* of both ends of each: where its others begin; their walls; NULL if no joint */
    int *jointFirst;                /* whether each of these comes first of those equally near */
    double *jointWays, *images;     /* by which it is moved to be the image there; ways of walls from their nearest images */
    double friction, wallFriction;  /* coefficients between grains, and at walls; 0: none */
    double spinDrag, turningOut;    /* drag on spins; angular velocity of the outer wall */
    double *speedWalls;             /* the same of each wall; with friction, wall 0 may be the inner circle */
    double *frictionWalls;          /* and the friction of each */
    int rough, moving, steps;       /* whether contacts have friction, and a wall inside moves; steps so far, */
    double turning, start;          /* if one does or gravity turns: at this angular velocity, from gravity at time 0; time at step 0 */
    double *motions;                /* of each: pivot, velocity, angular velocity, first and last time */
    double *w, *angle, *u;          /* with friction: spin, angle and rim speed r w of each grain, */
    double *dtContacts, *dtBoundary, *dtWalls; /* and tangential corrections, as the normal ones */
    int driven;                     /* whether a force drives a wall; if so, of the annulus and then of each wall: */
    double *drives;                 /* 1 / mass, force, pressure and direction, */
    double *places, *speeds;        /* and coordinate and speed */
    double period[2];               /* of the domain along x and y; 0 where it is not periodic */
    int bouncy;                     /* whether contacts bounce: between grains, at the annulus, and at each wall, */
    double restitution, restitutionOut, *restitutionWalls; /* by these coefficients, */
    double restitutionSpeed;        /* if they close faster */
    double *vxBefore, *vyBefore, *speedsBefore; /* velocities of grains, and of driven walls, before the step */
    int rolling;                    /* whether contacts resist rolling, by these coefficients; spin of a wall that is a circle: */
    double rollingFriction, wallRollingFriction, *rollingWalls, *spinWalls;
    double *drContacts, *drBoundary, *drWalls; /* rolling corrections, as the normal ones */
#endif
} femGrains;

femGrains *femGrainsCreateSimple(int n, double r, double m, double radiusIn, double radiusOut);
void femGrainsFree(femGrains *myGrains);
void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax);
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter);

#endif
