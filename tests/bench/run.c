/* Many steps of the reference, so that nothing but C is timed. */

#include "grains.h"

void run(femGrains *grains, int steps, double dt, double tol, double iterMax) {
    for (int k = 0; k < steps; k++) femGrainsUpdate(grains, dt, tol, iterMax);
}
