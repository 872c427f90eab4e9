/* The interface of the course text, with further fields of femGrains and two further functions of the reference. */

#ifndef GRAINS_H
#define GRAINS_H

#define REFERENCE
#include "fem.h"

/* A contact of grain i: with grain j > i, with the annulus where j = -1, or with wall -2 - j inside it. */
typedef struct {
    int i, j;
} femContact;

/* The same as femGrainsContactIterate, over the given contacts in the given order. */
double femGrainsContactIterateOrder(femGrains *myGrains, double dt, int iter, int nContacts,
                                    const femContact *contacts);

/* Set the speeds of walls that forces drive to those without contacts. */
void femGrainsFreeSpeeds(femGrains *myGrains, double dt);

#endif
