"""Drawing of the page: walls, grains as discs of their true radii, and force chains."""

import numpy as np
import viser
from numpy.typing import NDArray

from warpgrains.arrays import FloatArray, IndexArray
from warpgrains.drawing.chains import CHAIN_COLOR
from warpgrains.drawing.colors import linear
from warpgrains.drawing.shapes import WALL_COLOR
from warpgrains.pictures.shots import Setting, Shot

_SEGMENTS = 48  # of a circle
_FIELD_OF_VIEW = 0.5  # radians
_CHAINS = "/chains"


class Stage:
    """The 3D scene of a page, in the plane z = 0, seen from +z."""

    def __init__(self, server: viser.ViserServer, setting: Setting) -> None:
        self._scene = server.scene
        self._scene.set_up_direction("+y")
        server.initial_camera.position = (0.0, 0.0, 1.1 * setting.reach / np.tan(_FIELD_OF_VIEW / 2.0))
        server.initial_camera.look_at = (0.0, 0.0, 0.0)
        server.initial_camera.up = (0.0, 1.0, 0.0)
        server.initial_camera.fov = _FIELD_OF_VIEW
        self._scene.configure_default_lights(False)
        self._scene.configure_environment_map(None)
        self._scene.add_light_ambient("/light", intensity=np.pi)  # shows colors unchanged
        for number, ring in enumerate(setting.walls):
            wall = ring.shape()
            self._add_mesh(f"/walls/{number}", wall.points, wall.corners, WALL_COLOR)
        grains = len(setting.radius)
        corners, faces = _disc()
        self._grains = self._scene.add_batched_meshes_simple(
            "/grains",
            corners,
            faces,
            batched_wxyzs=np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (grains, 1)),
            batched_positions=np.zeros((grains, 3), dtype=np.float32),
            batched_scales=setting.radius.astype(np.float32),
            batched_colors=np.zeros((grains, 3), dtype=np.uint8),
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )
        self._has_chains = False

    def show(self, shot: Shot) -> None:
        """Draw a shot, replacing the last one."""
        places = np.zeros((len(shot.position), 3), dtype=np.float32)
        places[:, :2] = shot.position
        self._grains.batched_positions = places
        self._grains.batched_colors = np.rint(255.0 * linear(shot.color)).astype(np.uint8)
        if shot.chains is not None and len(shot.chains.force):
            corners = shot.chains.corners().reshape(-1, 2)
            raised = np.concatenate([corners, np.full((len(corners), 1), 0.01)], axis=1)
            self._add_mesh(_CHAINS, raised, np.arange(len(corners)), CHAIN_COLOR)
            self._has_chains = True
        elif self._has_chains:
            self._scene.remove_by_name(_CHAINS)
            self._has_chains = False

    def _add_mesh(
        self,
        name: str,
        points: FloatArray,
        corners: IndexArray,
        color: tuple[float, float, float],
    ) -> None:
        """Add a mesh of quadrilaterals."""
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


def _disc() -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Return the corners and triangles of a disc of radius 1."""
    angle = np.linspace(0.0, 2.0 * np.pi, _SEGMENTS, endpoint=False)
    corners = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    number = np.arange(1, _SEGMENTS - 1)
    faces = np.stack([0 * number, number, number + 1], axis=1)
    return corners.astype(np.float32), faces.astype(np.uint32)
