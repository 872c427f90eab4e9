"""Drawing of the page: walls, grains as discs of their true radii, and force chains."""

import numpy as np
import viser

from warpgrains.base.arrays import FloatArray, IndexArray
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.drawing.colors import linear, mark_color
from warpgrains.drawing.painter import Painter
from warpgrains.drawing.shapes import WALL_COLOR, mark, wall_mesh
from warpgrains.scene.snapshot import Snapshot
from warpgrains.walls.band import Band

_SEGMENTS = 48  # of a circle
_FIELD_OF_VIEW = 0.5  # radians
_SMALL_SCREEN, _SHEET = 576, 0.62  # width [pixels] below which viser has a sheet, and its share of the height
_CHAINS, _MARKS = "/chains", "/marks"
_MARK_HEIGHT, _CHAIN_HEIGHT = 0.005, 0.01  # above the grains, in half of the longer side of the view


class Stage:
    """The 3D scene of a page: walls, grains and force chains in the plane z = 0, seen from +z."""

    def __init__(self, server: viser.ViserServer, painter: Painter) -> None:
        self._scene = server.scene
        self._scene.set_up_direction("+y")
        self._view = painter.view
        server.initial_camera.position = (*painter.view.center, self._distance(1.0))
        server.initial_camera.look_at = (*painter.view.center, 0.0)
        server.initial_camera.up = (0.0, 1.0, 0.0)
        server.initial_camera.fov = _FIELD_OF_VIEW
        server.on_client_connect(self._follow)
        self._scene.configure_default_lights(False)
        self._scene.configure_environment_map(None)
        self._scene.add_light_ambient("/light", intensity=np.pi)  # shows colors unchanged
        for name, wall in painter.walls.items():
            self._add_wall(name, wall)
        self._reach = painter.view.half
        self._reserve(painter.scene.n * 2 ** int(np.count_nonzero(painter.scene.period.repeats)))
        self._has_chains = False

    def _reserve(self, grains: int) -> None:
        """Replace the drawn discs and marks by new ones, whose fixed number suffices for `grains` grains."""
        self._slots = grains
        angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS, endpoint=False)
        self._grains = self._add_instances("/grains", np.stack([np.cos(angle), np.sin(angle)], axis=1))
        self._marks = self._add_instances(_MARKS, mark())

    def _distance(self, height: float) -> float:
        """Return the distance of the camera [m] at which the view fills a fraction `height` of the window.

        This is the fraction of the window's height that the longer side of the view and a margin take.
        """
        return 1.1 * self._view.half / height / float(np.tan(_FIELD_OF_VIEW / 2.0))

    def _follow(self, client: viser.ClientHandle) -> None:
        """Keep the whole view visible in the window of a client, whenever its size changes."""
        camera, shown = client.camera, [(0, 0)]

        def fit(_: object) -> None:
            width, height = size = camera.image_width, camera.image_height
            if size == shown[0]:
                return
            shown[0] = size
            # on a small screen, the panel is a sheet over the lower part of the window
            free = 1.0 - _SHEET if width < _SMALL_SCREEN else 1.0
            x, y = self._view.center
            part = min(free, width / height)
            y -= 1.1 * self._view.half * (1.0 - free) / part
            camera.position, camera.look_at = (x, y, self._distance(part)), (x, y, 0.0)

        camera.on_update(fit)
        fit(None)

    def show(self, now: Snapshot, painter: Painter) -> None:
        """Draw a snapshot, replacing the last one."""
        for name, wall in painter.moved_walls(now.scene, now.time).items():
            self._add_wall(name, wall)
        (places, grain), chains = now.images, painter.chains(now)
        if len(grain) > self._slots:  # grains were added
            self._reserve(len(grain) * 3 // 2)
        unused = 0, self._slots - len(grain)  # of instances, whose number is fixed: of radius 0
        places, radius = np.pad(places, (unused, (0, 0))), np.pad(now.scene.radius[grain], unused)
        grain = np.pad(grain, unused)
        color = painter.color(now)[grain]
        _place(self._grains, places, 0.0, radius, color)
        self._marks.visible = now.scene.has_friction
        if self._marks.visible:
            half, zero = 0.5 * now.angle[grain], np.zeros(self._slots)
            turned = np.stack([np.cos(half), zero, zero, np.sin(half)], axis=1)
            self._marks.batched_wxyzs = turned.astype(np.float32)
            _place(self._marks, places, _MARK_HEIGHT * self._reach, radius, mark_color(color))
        if chains is not None and len(chains.width):
            corners = chains.corners.reshape(-1, 2)
            raised = np.insert(corners, 2, _CHAIN_HEIGHT * self._reach, axis=1)
            self._add_mesh(_CHAINS, raised, np.arange(len(corners)), CHAIN_COLOR)
            self._has_chains = True
        elif self._has_chains:
            self._scene.remove_by_name(_CHAINS)
            self._has_chains = False

    def _add_wall(self, name: str, wall: Band) -> None:
        mesh = wall_mesh(wall)
        self._add_mesh(f"/walls/{name}", mesh.points, mesh.corners, WALL_COLOR)

    def _add_instances(self, name: str, outline: FloatArray) -> viser.BatchedMeshHandle:
        """Add copies of a convex polygon, as many as `_reserve` has set, of size 0; return their mesh.

        `outline` holds the corners of the polygon of a grain of radius 1, shape (k, 2).
        """
        grains, number = self._slots, np.arange(1, len(outline) - 1)
        return self._scene.add_batched_meshes_simple(
            name,
            np.insert(outline, 2, 0.0, axis=1).astype(np.float32),
            np.stack([0 * number, number, number + 1], axis=1).astype(np.uint32),
            batched_wxyzs=np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (grains, 1)),
            batched_positions=np.zeros((grains, 3), dtype=np.float32),
            batched_scales=np.zeros(grains, dtype=np.float32),
            batched_colors=np.zeros((grains, 3), dtype=np.uint8),
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _add_mesh(
        self, name: str, points: FloatArray, corners: IndexArray, color: tuple[float, float, float]
    ) -> None:
        faces = corners.reshape(-1, 4)[:, [[0, 1, 2], [0, 2, 3]]]
        self._scene.add_mesh_simple(
            name,
            points.astype(np.float32),
            faces.reshape(-1, 3).astype(np.uint32),
            color=color,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )


def _place(
    shapes: viser.BatchedMeshHandle,
    position: FloatArray,
    height: float,
    radius: FloatArray,
    color: FloatArray,
) -> None:
    """Set position [m], radius [m] and color (sRGB) of each copy, and the height of all above z = 0 [m]."""
    shapes.batched_scales = radius.astype(np.float32)
    shapes.batched_positions = np.insert(position, 2, height, axis=1).astype(np.float32)
    shapes.batched_colors = np.rint(255.0 * linear(color)).astype(np.uint8)
