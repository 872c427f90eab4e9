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
    /* Only in the reference: whether the scheme is the leapfrog, v is half a step behind, the outer wall is round. */
    int leapfrog, staggered, round;
    int nWalls;                     /* number of walls inside the annulus */
    double *walls, *dvWalls;        /* SHAPE numbers of each wall, and corrections by grain and wall */
    int *jointStart, *joints;       /* index of the first joined wall of each end of each wall; joined walls; or NULL */
    int *jointFirst;                /* whether the joined wall comes first if both are equally near */
    double *jointWays, *images;     /* shift of a joined wall to its image at the joint; of walls from nearest images */
    double friction, wallFriction;  /* coefficients between grains, and at the annulus; 0 without friction */
    double spinDrag, turningOut;    /* drag on spins; angular velocity of the outer circle */
    double *speedWalls;             /* speed of the surface of each wall; with friction, wall 0 may be the inner circle */
    double *frictionWalls;          /* friction of each wall */
    int rough, moving, steps;       /* whether there is friction; whether a wall inside moves; steps done */
    double turning, start;          /* angular velocity of gravity, which is gravity[] at time 0; time at step 0 */
    double *motions;                /* of each wall: pivot, velocity, angular velocity, first and last time */
    double *w, *angle, *u;          /* spin, angle and rim speed r w of each grain */
    double *dtContacts, *dtBoundary, *dtWalls; /* tangential corrections, stored as the normal ones */
    int driven;                     /* whether a force drives a wall */
    double *drives;                 /* of the annulus, then of each wall: DRIVE numbers, see grains.c */
    double *places, *speeds;        /* of the annulus, then of each wall: coordinate and speed */
    double period[2];               /* length of the domain along x and y; 0 if it is not periodic */
    int bouncy;                     /* whether contacts bounce */
    double restitution, restitutionOut, *restitutionWalls; /* coefficients between grains, at the annulus, at each wall */
    double restitutionSpeed;        /* contacts that close more slowly do not bounce */
    double *vxBefore, *vyBefore, *speedsBefore; /* velocities of grains, and of driven walls, before the step */
    int rolling;                    /* whether contacts resist rolling */
    double rollingFriction, wallRollingFriction, *rollingWalls; /* coefficients, as those of friction */
    double *spinWalls;              /* spin of each wall that is a circle */
    double *drContacts, *drBoundary, *drWalls; /* rolling corrections, stored as the normal ones */
#endif
} femGrains;

femGrains *femGrainsCreateSimple(int n, double r, double m, double radiusIn, double radiusOut);
void femGrainsFree(femGrains *myGrains);
void femGrainsUpdate(femGrains *myGrains, double dt, double tol, double iterMax);
double femGrainsContactIterate(femGrains *myGrains, double dt, int iter);

#endif
