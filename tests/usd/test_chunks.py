import re

import numpy as np
import pytest
from pxr import Sdf, Usd
from recordings import GRAINS, grains_of, make_frames, make_scene, points_recorder, record

from warpgrains.errors import SceneError
from warpgrains.usd import chunks as usd_chunks
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import chunks_of, recover


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(usd_chunks, "CHUNK_FRAMES", 4)


def cut_short(path, frames, error=KeyboardInterrupt, **options):
    """Record frames and leave the block by an error; return the folder of chunks."""

    def frames_until_the_error():
        yield from frames
        raise error

    with pytest.raises(error):
        record(path, frames_until_the_error(), **options)
    return chunks_of(path)


def require_frames(path, frames):
    assert inspect_recording(path) == []
    stage = Usd.Stage.Open(str(path))
    points = grains_of(stage).GetPointsAttr()
    written = np.array([points.Get(code) for code in points.GetTimeSamples()])
    assert np.array_equal(written[:, :, :2], frames[:, 0].astype(np.float32))


class TestWhileRunning:
    @pytest.mark.parametrize("count", [4, 5, 9])
    @pytest.mark.parametrize("options", [{}, {"draw_as": "discs"}, {"color_by": "pressure", "forces": True}])
    def test_viewers_see_all_that_is_flushed(self, tmp_path, count, options):
        chunks = cut_short(tmp_path / "run.usdc", make_frames(count), **options)
        assert inspect_recording(chunks / "root.usda") == []
        stage = Usd.Stage.Open(str(chunks / "root.usda"))
        assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0, count - 1)
        assert len(stage.GetPrimAtPath(GRAINS).GetAttribute("velocities").GetTimeSamples()) == count

    def test_half_frames_are_interpolated_across_chunks(self, tmp_path):
        frames = make_frames(9)
        stage = Usd.Stage.Open(str(cut_short(tmp_path / "run.usdc", frames) / "root.usda"))
        between = np.array(grains_of(stage).GetPointsAttr().Get(3.5))[:, :2]
        assert np.allclose(between, frames[3:5, 0].mean(axis=0), atol=1e-6)

    def test_chunks_hold_so_many_frames(self, tmp_path):
        chunks = cut_short(tmp_path / "run.usdc", make_frames(9))
        names = [f"chunk.{first:08d}.usdc" for first in (0, 4, 8)]
        assert sorted(path.name for path in chunks.iterdir()) == [
            *names,
            "manifest.usda",
            "root.usda",
            "static.usdc",
        ]

    def test_chunks_hold_so_many_bytes(self, tmp_path, monkeypatch):
        monkeypatch.setattr(usd_chunks, "CHUNK_BYTES", 2 * (2 * 5 * 12 + 24))
        chunks = cut_short(tmp_path / "run.usdc", make_frames(3))
        assert inspect_recording(chunks / "root.usda") == []
        assert {path.name for path in chunks.glob("chunk.*")} == {
            "chunk.00000000.usdc",
            "chunk.00000002.usdc",
        }


class TestNothingIsLost:
    @pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
    @pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
    def test_a_block_left_by_an_error_keeps_its_frames_apart(self, tmp_path, error, suffix):
        frames = make_frames(6)
        chunks = cut_short(tmp_path / f"run{suffix}", frames, error)
        assert list(tmp_path.iterdir()) == [chunks]
        assert recover(chunks) == (tmp_path / f"run{suffix}", 6)
        require_frames(tmp_path / f"run{suffix}", frames)

    @pytest.mark.parametrize("count", [0, 3])
    def test_a_block_left_within_the_first_chunk_leaves_nothing(self, tmp_path, count):
        cut_short(tmp_path / "run.usdc", make_frames(count))
        assert list(tmp_path.iterdir()) == []

    def test_an_earlier_file_stays_until_the_new_one_is_whole(self, tmp_path):
        path = record(tmp_path / "run.usdc", make_frames(4))
        before = path.read_bytes()
        cut_short(path, make_frames(5), ValueError)
        assert path.read_bytes() == before

    def test_a_whole_file_replaces_an_earlier_one_and_stands_alone(self, tmp_path):
        path = record(tmp_path / "run.usdc", make_frames(4))
        record(path, make_frames(9, seed=1))
        require_frames(path, make_frames(9, seed=1))
        assert list(tmp_path.iterdir()) == [path]

    def test_frames_of_another_run_are_not_touched(self, tmp_path):
        chunks = cut_short(tmp_path / "run.usdc", make_frames(5))
        before = {path: path.read_bytes() for path in chunks.iterdir()}
        with pytest.raises(SceneError, match=r"run.usdc.chunks' holds frames of another run"):
            points_recorder(tmp_path / "run.usdc", make_scene())
        assert {path: path.read_bytes() for path in chunks.iterdir()} == before

    def test_frames_lost_in_writing_a_chunk_are_noticed(self, tmp_path, monkeypatch):
        monkeypatch.setattr(Sdf.Layer, "SetTimeSample", lambda *arguments: None)
        with pytest.raises(
            OSError, match=re.escape("holds 0 frames of /World/Grains.points after writing 1")
        ):
            record(tmp_path / "run.usdc", make_frames(1))
        assert list(tmp_path.iterdir()) == []

    def test_frames_lost_in_joining_the_chunks_are_noticed(self, tmp_path, monkeypatch):
        chunks = cut_short(tmp_path / "run.usdc", make_frames(9))
        write = Sdf.Layer.SetTimeSample

        def forget_one(layer, path, code, value):
            if (path.name, code) != ("velocities", 5):
                write(layer, path, code, value)

        monkeypatch.setattr(Sdf.Layer, "SetTimeSample", forget_one)
        with pytest.raises(OSError, match=re.escape("holds 8 frames of /World/Grains.velocities after")):
            recover(chunks)
        monkeypatch.undo()
        assert list(tmp_path.iterdir()) == [chunks]
        assert recover(chunks)[1] == 9

    def test_a_chunk_that_could_not_be_written_is_tried_again(self, tmp_path, monkeypatch):
        frames = make_frames(9)
        with points_recorder(tmp_path / "run.usdc", make_scene()) as recorder:
            for frame in frames[:3]:
                recorder.record(*frame)
            with monkeypatch.context() as full_disk:
                full_disk.setattr(usd_chunks, "chunk_layer", lambda *_: Sdf.Layer.CreateAnonymous(".usdc"))
                with pytest.raises(OSError, match="holds 0 frames"):
                    recorder.record(*frames[3])
                assert not list(recorder.chunks.glob(".draft.*"))
            for frame in frames[4:]:
                recorder.record(*frame)
        require_frames(tmp_path / "run.usdc", frames)

    def test_a_chunk_lost_during_the_run_is_noticed(self, tmp_path):
        recorder = points_recorder(tmp_path / "run.usdc", make_scene())
        for frame in make_frames(12):
            recorder.record(*frame)
        (recorder.chunks / "chunk.00000004.usdc").unlink()
        with pytest.raises(
            OSError, match=re.escape("holds 8 frames of /World/Grains.points after writing 12")
        ):
            recorder.close()
        assert list(tmp_path.iterdir()) == [recorder.chunks]

    def test_frames_after_a_gap_are_left_out(self, tmp_path):
        frames = make_frames(12)
        chunks = cut_short(tmp_path / "run.usdc", frames)
        (chunks / "chunk.00000004.usdc").unlink()
        assert recover(chunks)[1] == 4
        require_frames(tmp_path / "run.usdc", frames[:4])


class TestResume:
    def test_continues_as_if_never_cut_short(self, tmp_path):
        frames, path = make_frames(11), tmp_path / "run.usdc"
        killed = points_recorder(path, make_scene())
        for number, frame in enumerate(frames[:10]):
            killed.record(*frame)
            if number in (5, 9):
                killed.flush()
        assert len(list(chunks_of(path).glob("chunk.*"))) == 3
        del killed  # and with it its lock
        with points_recorder(path, make_scene(), resume_at=6) as recorder:
            assert inspect_recording(chunks_of(path) / "root.usda") == []
            assert recorder.frames == 6
            for frame in frames[6:]:
                recorder.record(*frame)
        require_frames(path, frames)

    def test_refuses_chunks_that_end_elsewhere(self, tmp_path):
        cut_short(tmp_path / "run.usdc", make_frames(6))
        with pytest.raises(SceneError, match="holds 6 of the 7 frames"):
            points_recorder(tmp_path / "run.usdc", make_scene(), resume_at=7)
        with pytest.raises(SceneError, match="holds 6 of the 5 frames"):
            points_recorder(tmp_path / "run.usdc", make_scene(), resume_at=5)

    def test_refuses_chunks_of_another_scene_or_drawing(self, tmp_path):
        cut_short(tmp_path / "run.usdc", make_frames(4))
        for scene, options in ((make_scene(text="other"), {}), (make_scene(), {"color_by": "radius"})):
            with pytest.raises(SceneError, match="holds no frames of this scene"):
                points_recorder(tmp_path / "run.usdc", scene, resume_at=4, **options)

    def test_refuses_what_is_not_there(self, tmp_path):
        with pytest.raises(SceneError, match="holds no frames of this scene"):
            points_recorder(tmp_path / "run.usdc", make_scene(), resume_at=4)
