import numpy as np
import pytest
from pxr import Usd, UsdGeom
from recordings import (
    RADIUS,
    Contacts,
    WallContacts,
    grains_of,
    make_contacts,
    make_frames,
    make_scene,
    record,
)

from warpgrains.usd.colors import Frame, GrainColors, force_scale, pressure, pressure_scale, speed_scale
from warpgrains.usd.recorder import Recorder

HIGHEST = GrainColors(make_scene(), "radius").still[np.argmax(RADIUS)]
LOWEST = GrainColors(make_scene(), "radius").still[np.argmin(RADIUS)]


def test_pressure_is_force_over_circumference():
    contacts = Contacts(np.array([(0, 1), (0, 4)]), np.array([3.0, 5.0]))
    wall_contacts = WallContacts(np.array([0.0, 2.0, 0.0, -7.0, 0.0]))
    frame = Frame(*make_frames(1)[0], contacts, wall_contacts)
    total = np.array([3 + 5, 3 + 2, 0, 7, 5])
    assert np.array_equal(pressure(frame, RADIUS), total / (2 * np.pi * RADIUS))


def no_contacts(wall):
    return Contacts(np.empty((0, 2), dtype=int), np.empty(0)), WallContacts(np.array(wall))


def test_scales_come_from_the_scene():
    scene = make_scene(gravity=(0, -10), drag=0.0)
    assert speed_scale(scene) == pytest.approx(np.sqrt(2 * 10 * 2.0))
    assert speed_scale(make_scene(gravity=(0, -10), drag=5.0)) == pytest.approx(10 * 1.0 / 5.0)
    assert speed_scale(make_scene(gravity=(0, 0), velocity=np.full((5, 2), 3.0))) == pytest.approx(3 * 2**0.5)
    assert pressure_scale(scene) == pytest.approx(5 * 10 / 1.0)
    assert force_scale(scene) == pytest.approx(50 * 2 * RADIUS.mean())
    thrown = make_scene(gravity=(0, 0), velocity=np.full((5, 2), 3.0))
    assert pressure_scale(thrown) == pytest.approx(3 * 2**0.5 / 0.01 / (2 * np.pi * RADIUS.mean()))
    assert pressure_scale(make_scene(gravity=(0, 0))) == pytest.approx(1 / 0.01**2 / (2 * np.pi))


def test_neighbours_in_the_palette_differ():
    colors = GrainColors(make_scene(), "palette").still
    assert (colors[1:] != colors[:-1]).any(axis=1).all()


@pytest.mark.parametrize("color_by", ["speed", "pressure"])
def test_colors_run_from_nothing_to_the_scale_and_no_further(color_by):
    scene = make_scene()
    velocity = speed_scale(scene) * np.array([[0, 0], [0, 0.5], [-1, 0], [7, 0], [0, 0]])
    wall = pressure_scale(scene) * 2 * np.pi * RADIUS * np.array([0, 0.5, -1, 7, 0])
    colors = GrainColors(scene, color_by).of(Frame(scene.position, velocity, *no_contacts(wall)))
    assert colors.shape == (5, 3)
    assert np.array_equal(colors[[0, 4]], [LOWEST, LOWEST])
    assert np.array_equal(colors[[2, 3]], [HIGHEST, HIGHEST])
    assert not (colors[1] == LOWEST).all()
    assert not (colors[1] == HIGHEST).all()


def test_a_scene_without_a_scale_has_the_lowest_color():
    scene = make_scene(np.full(5, 0.1), gravity=(0, 0))
    colors = GrainColors(scene, "radius").still
    assert np.array_equal(colors, np.tile(LOWEST, (5, 1)))
    frame = Frame(scene.position, scene.velocity, *no_contacts(np.zeros(5)))
    for color_by in ("speed", "pressure"):
        assert np.array_equal(GrainColors(scene, color_by).of(frame), colors)


@pytest.mark.parametrize(
    ("color_by", "codes"), [("palette", 0), ("radius", 0), ("speed", 3), ("pressure", 3)]
)
def test_only_what_changes_is_written_each_frame(tmp_path, color_by, codes):
    stage = Usd.Stage.Open(str(record(tmp_path / "run.usdc", make_frames(3), color_by=color_by)))
    color = grains_of(stage).GetDisplayColorPrimvar()
    assert color.GetAttr().GetNumTimeSamples() == codes
    assert color.GetInterpolation() == "vertex"
    assert len(color.Get(1)) == 5


class TestForceChains:
    @pytest.fixture
    def curves(self, tmp_path):
        self.frames = make_frames(3)
        stage = Usd.Stage.Open(str(record(tmp_path / "run.usdc", self.frames, forces=True)))
        return stage, UsdGeom.BasisCurves(stage.GetPrimAtPath("/World/Forces"))

    def test_join_centres_and_walls(self, curves):
        for code in range(3):
            position = self.frames[code, 0]
            ends = np.array(curves[1].GetPointsAttr().Get(code)).reshape(-1, 2, 3)
            pairs = [position[[0, 1]], position[[1, 2]], position[[0, 4]]]
            assert np.array_equal(ends[:3, :, :2], np.float32(pairs))
            for grain, side, (centre, foot) in zip((0, 3), (1, -1), ends[3:, :, :2], strict=True):
                outwards = position[grain] / np.linalg.norm(position[grain])
                assert np.array_equal(centre, np.float32(position[grain]))
                assert np.allclose(foot, position[grain] + side * RADIUS[grain] * outwards, atol=1e-6)
            assert (ends[:, :, 2] > RADIUS.max()).all()

    def test_are_as_wide_as_their_forces_up_to_the_smallest_grain(self, curves):
        contacts, wall_contacts = make_contacts(seed=1)
        force = np.concatenate([contacts.force[:3], np.abs(wall_contacts.force[[0, 3]])])
        expected = np.minimum(force / force_scale(make_scene()), 1.0) * 2 * RADIUS.min()
        widths = np.array(curves[1].GetWidthsAttr().Get(1))
        assert np.array_equal(widths, np.repeat(np.float32(expected), 2))
        assert list(curves[1].GetCurveVertexCountsAttr().Get(1)) == [2] * 5

    def test_may_be_none(self, tmp_path):
        scene = make_scene()
        with Recorder(tmp_path / "run.usdc", scene, 60, forces=True) as recorder:
            recorder.record(scene.position, scene.velocity, *no_contacts(np.zeros(5)))
        stage = Usd.Stage.Open(str(tmp_path / "run.usdc"))
        assert len(stage.GetAttributeAtPath("/World/Forces.points").Get(0)) == 0
