"""The common flow in Kamino, a solver of Newton: projected Gauss-Seidel in Warp, in single precision."""

from typing import Any

import numpy as np
import warp as wp

from warpgrains import Scene
from warpgrains.base.arrays import FloatArray

from .debian import FRAME


@wp.struct
class Contacts:
    """Arrays of Newton's contacts, to which `touch_outer_wall` appends those of the outer wall.

    `outer` is the radius of this wall, and `radius` that of the grains [m].
    """

    count: wp.array(dtype=int)
    shape0: wp.array(dtype=int)
    shape1: wp.array(dtype=int)
    point0: wp.array(dtype=wp.vec3f)
    point1: wp.array(dtype=wp.vec3f)
    offset0: wp.array(dtype=wp.vec3f)
    offset1: wp.array(dtype=wp.vec3f)
    normal: wp.array(dtype=wp.vec3f)
    margin0: wp.array(dtype=float)
    margin1: wp.array(dtype=float)
    outer: float
    radius: float


@wp.kernel
def enter_plane(
    q: wp.array(dtype=wp.transformf),
    qd: wp.array(dtype=wp.spatial_vectorf),
    force: wp.array(dtype=wp.spatial_vectorf),
    drag: float,
):
    i = wp.tid()
    x, v, spin = wp.transform_get_translation(q[i]), wp.spatial_top(qd[i]), wp.spatial_bottom(qd[i])[2]
    v = wp.vec3f(v[0], v[1], 0.0)
    q[i] = wp.transformf(wp.vec3f(x[0], x[1], 0.0), wp.quat_identity(float))
    qd[i] = wp.spatial_vector(v, wp.vec3f(0.0, 0.0, spin))
    force[i] = wp.spatial_vector(-drag * v, wp.vec3f())


@wp.kernel
def touch_outer_wall(q: wp.array(dtype=wp.transformf), wall: int, contacts: Contacts):
    i = wp.tid()
    x = wp.transform_get_translation(q[i])
    rho = wp.length(x)
    if contacts.outer - rho < 2.0 * contacts.radius:
        k = wp.atomic_add(contacts.count, 0, 1)
        contacts.shape0[k] = i
        contacts.shape1[k] = wall
        contacts.point0[k] = wp.vec3f()
        contacts.point1[k] = x * (contacts.outer / rho)
        contacts.offset0[k] = x * (contacts.radius / rho)
        contacts.offset1[k] = wp.vec3f()
        contacts.normal[k] = x / rho
        contacts.margin0[k] = contacts.radius
        contacts.margin1[k] = 0.0


class Kamino:
    """The flow in Kamino with its solver DVI: spheres kept in a plane, in steps of 10 ms.

    As in the text, a contact may close its gap within a step. Newton finds contacts of spheres and of the
    inner cylinder within a gap of one radius. It has no shape for the outer wall, whose contacts are added as
    contacts of the inner wall. An iteration is two sweeps.
    """

    def __init__(self, scene: Scene, iterations: int):
        import newton

        self._radius, self._n = float(scene.radius[0]), len(scene.radius)
        self._drag = scene.drag
        self._model = model = _model(newton, scene).finalize(device="cpu")
        model.rigid_contact_max = 8 * self._n + 64
        config = newton.solvers.SolverKamino.Config.from_model(model, dynamics_solver="dvi")
        config.sparse_jacobian = config.sparse_dynamics = True
        config.dynamics.linear_solver_type = "CR"  # the solver for sparse dynamics
        config.constraints.gamma, config.constraints.delta = 1.0, 0.0
        config.dynamics.cull_speculative_contacts = False
        config.dvi.max_alternating_iterations, config.dvi.tolerance = iterations, 0.0
        self._solver = newton.solvers.SolverKamino(model, config=config)
        self._pipeline = newton.CollisionPipeline(model, broad_phase="sap")
        self._contacts = self._pipeline.contacts()
        self._state, self._next = model.state(), model.state()
        velocity = np.zeros((self._n, 6), np.float32)
        velocity[:, :2] = scene.velocity
        self._state.body_qd.assign(velocity)
        self._wall = Contacts()
        for name in Contacts.vars.keys() - {"outer", "radius"}:
            setattr(self._wall, name, getattr(self._contacts, f"rigid_contact_{name}"))
        self._wall.outer, self._wall.radius = scene.radius_out, self._radius

    def advance(self, frames: int) -> None:
        for _ in range(frames):
            state = self._state
            moving = [state.body_q, state.body_qd, state.body_f, self._drag]
            wp.launch(enter_plane, self._n, moving, device="cpu")
            self._pipeline.collide(state, self._contacts)
            wp.launch(touch_outer_wall, self._n, [state.body_q, self._n, self._wall], device="cpu")
            self._solver.step(state, self._next, None, self._contacts, FRAME)
            self._state, self._next = self._next, state

    def position(self) -> FloatArray:
        return self._state.body_q.numpy()[:, :2].astype(np.float64)


def _model(newton: Any, scene: Scene) -> Any:
    """Return a builder of Newton's model with one sphere per body; the last shape is the inner wall."""
    radius, mass = float(scene.radius[0]), float(scene.mass[0])
    shape = newton.ModelBuilder.ShapeConfig(
        density=0.0,  # bodies have mass, and inertia of discs
        mu=scene.friction,
        mu_torsional=0.0,
        mu_rolling=0.0,
        gap=0.5 * radius,
    )
    inertia = wp.mat33(*(0.5 * mass * radius**2 * np.eye(3)).ravel().tolist())
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=(*scene.gravity, 0.0))
    for x, y in scene.position.tolist():
        place = wp.transform(wp.vec3(x, y, 0.0), wp.quat_identity())
        body = builder.add_body(xform=place, mass=mass, inertia=inertia)
        builder.add_shape_sphere(body, radius=radius, cfg=shape)
    builder.add_shape_cylinder(-1, radius=scene.radius_in, half_height=1.0, cfg=shape)
    return builder
