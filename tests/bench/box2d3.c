/* Discs within polygons in Box2D 3.1 or newer: no rebound, no sleep, one thread. */

#include <stdlib.h>

#include "box2d/box2d.h"

typedef struct {
    b2WorldId world;
    int n;
    float friction;
    b2BodyId bodies[];
} Discs;

static b2ShapeDef material(float density, float friction) {
    b2ShapeDef shape = b2DefaultShapeDef();
    shape.density = density;
    shape.material.friction = friction;
    shape.material.restitution = 0.0f;
    return shape;
}

/* A hertz of 0 leaves the stiffness of contacts as it is by default. */
Discs *create(int n, float gravityX, float gravityY, float hertz, float friction) {
    Discs *discs = malloc(sizeof(Discs) + n * sizeof(b2BodyId));
    b2WorldDef world = b2DefaultWorldDef();
    world.gravity = (b2Vec2){gravityX, gravityY};
    world.enableSleep = false;
    world.workerCount = 1;
    world.maximumLinearSpeed = 1e9f;  /* lengths are scaled, and so are speeds */
    if (hertz > 0.0f) world.contactHertz = hertz;
    discs->world = b2CreateWorld(&world);
    discs->n = n;
    discs->friction = friction;
    return discs;
}

/* A closed polygon: a body of segments. */
void addWall(Discs *discs, int corners, const b2Vec2 *corner) {
    b2BodyDef body = b2DefaultBodyDef();
    b2BodyId wall = b2CreateBody(discs->world, &body);
    b2ShapeDef shape = material(0.0f, discs->friction);
    for (int k = 0; k < corners; k++) {
        b2Segment side = {corner[k], corner[(k + 1) % corners]};
        b2CreateSegmentShape(wall, &shape, &side);
    }
}

void addDiscs(Discs *discs, const b2Vec2 *x, const b2Vec2 *v, const float *radius, const float *mass, float drag) {
    for (int i = 0; i < discs->n; i++) {
        b2BodyDef body = b2DefaultBodyDef();
        body.type = b2_dynamicBody;
        body.position.x = x[i].x;
        body.position.y = x[i].y;
        body.linearVelocity = v[i];
        body.linearDamping = drag / mass[i];
        discs->bodies[i] = b2CreateBody(discs->world, &body);
        b2ShapeDef shape = material(mass[i] / (B2_PI * radius[i] * radius[i]), discs->friction);
        b2Circle circle = {{0.0f, 0.0f}, radius[i]};
        b2CreateCircleShape(discs->bodies[i], &shape, &circle);
    }
}

void advance(Discs *discs, int steps, float dt, int substeps) {
    for (int k = 0; k < steps; k++) b2World_Step(discs->world, dt, substeps);
}

void positions(const Discs *discs, double *x) {
    for (int i = 0; i < discs->n; i++) {
        x[2 * i] = b2Body_GetPosition(discs->bodies[i]).x;
        x[2 * i + 1] = b2Body_GetPosition(discs->bodies[i]).y;
    }
}

void destroy(Discs *discs) {
    b2DestroyWorld(discs->world);
    free(discs);
}
