import json
import os
import re
import struct
from errno import ENOSPC
from zipfile import ZipFile

import numpy as np
import pytest
from command import small_disk
from pxr import Sdf, Usd
from recordings import FORMS, RADIUS, grains_of, make_frames, make_scene, moment, moments, record, recorder_of

import warpgrains
from warpgrains import files
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.errors import InputError
from warpgrains.frame_log import _MAGIC, FrameLog, LogReader, _record
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import log_of, recover
from warpgrains.usd.writer import reopen_log

FILES = [*((suffix, "points", 0.0) for suffix in RECORDINGS), *((".usdc", draw_as, 0.3) for draw_as in FORMS)]
"""Endings, forms of grains, and frictions."""


def cut_short(path, frames, scene=None, error=KeyboardInterrupt, **options):
    """Record frames and leave the block by an error; return the log."""

    def frames_until_the_error():
        yield from frames
        raise error

    with pytest.raises(error):
        record(path, frames_until_the_error(), scene, **options)
    return log_of(path)


def append(recorder, frames):
    for frame in frames:
        recorder.record(moment(*frame))


def require_frames(path, frames):
    assert inspect_recording(path) == []
    stage = Usd.Stage.Open(str(path))
    points = grains_of(stage).GetPointsAttr()
    written = np.array([points.Get(code) for code in points.GetTimeSamples()])
    assert np.array_equal(written[:, :, :2], frames[:, 0].astype(np.float32))


def ends_of_records(log):
    reader = LogReader(log)
    return [reader.end, *(reader.end for _ in reader)]


class TestLog:
    def test_arrays_are_read_as_they_were_written(self, tmp_path):
        frames = [
            {
                "b": np.arange(3 * k, dtype=np.float32).reshape(k, 3),
                "a": np.full(k + 1, -k, np.int32),
                "c": np.full(k, 1.0 / 3.0),
            }
            for k in range(4)
        ]
        log = FrameLog(tmp_path / "log", "constants")
        for frame in frames:
            log.append(frame)
        reader = LogReader(tmp_path / "log")
        assert (reader.constants, reader.kinds) == ("constants", {"a": "<i4", "b": "(3,)<f4", "c": "<f8"})
        for _ in range(2):
            read = list(reader)
            assert len(read) == 4
            for ours, theirs in zip(frames, read, strict=True):
                assert all(np.array_equal(ours[name], theirs[name]) for name in "abc")
                assert all(theirs[name].flags.aligned for name in "abc")

    def test_a_frame_is_repeated_after_a_failed_flush(self, tmp_path, monkeypatch):
        def fail(file):
            raise OSError(ENOSPC, "no space")

        log = FrameLog(tmp_path / "log", "constants")
        for k in range(100):
            log.append({"a": np.full(2, k, np.int32)})
        with monkeypatch.context() as full:
            full.setattr(os, "fsync", fail)
            with pytest.raises(OSError, match="no space"):
                log.append({"a": np.full(2, 100, np.int32)})
        log.append({"a": np.full(2, 100, np.int32)})
        assert [frame["a"][0] for frame in LogReader(log.path)] == list(range(101))

    def test_killed_at_any_byte_keeps_every_complete_frame(self, tmp_path):
        frames = make_frames(3)
        log = cut_short(tmp_path / "run.usdc", frames)
        content, ends = log.read_bytes(), ends_of_records(log)
        assert ends[-1] == len(content)
        for size in [*range(ends[1], len(content) + 1, 7), *ends[1:]]:
            log.write_bytes(content[:size])
            assert len(list(LogReader(log))) == sum(end <= size for end in ends[1:])

    def test_what_cannot_be_written_leaves_the_log_as_it_was(self, tmp_path):
        frames = make_frames(9)
        with recorder_of(tmp_path / "run.usdc") as recorder:
            append(recorder, frames[:3])
            before = recorder.log.read_bytes()
            assert len(list(LogReader(recorder.log))) == 3  # a process that is killed now loses none
            too_large = pytest.raises(OSError, match=r"run.usdc.frames' cannot be written: File too large")
            with too_large, small_disk(len(before) + 50):
                recorder.record(moment(*frames[3]))
            assert recorder.log.read_bytes() == before
            assert recorder.frames == 3
            append(recorder, frames[3:])
        require_frames(tmp_path / "run.usdc", frames)


LAYER = '#usda 1.0\ndef Points "P" {{ int[] a\n point3f[] b\n {} }}\n'
KINDS = {"/P.a": "<i4", "/P.b": "(3,)<f4"}
NESTED = "customData = {" + "dictionary d = {" * 100_000
NO_KINDS = ["O", 7, None, "V0", "<U4", "<M8", "(0,)<f4", "(999999999,)<f4", "<f3", "", [], "i4,f4", "|b1"]
CRAFTED = {
    "kinds that are none": [{"kinds": KINDS | {"/P.a": kind}} for kind in NO_KINDS],
    "kinds that are no table": [{"kinds": kinds} for kinds in (None, 3, "<f4", ["<f4"])],
    "constants that are none": [
        {"constants": text} for text in (None, 3, "", "#usda 1.0", "\ud800", LAYER[:40])
    ],
    "nested constants": [{"constants": LAYER.format(NESTED)}],
    "other names": [{"kinds": dict.fromkeys(names, "<i4")} for names in (["/P.c"], ["/P"], ["a b"], [""])],
    "other types": [{"kinds": KINDS | {"/P.a": kind}} for kind in ("<f4", "<i8", "<u4", "(3,)<i4")],
    "headers that are none": [b"", b"7", b"{}", b"[" * 100_000, b'{"a":' * 100_000, b"\xff"],
}
"""Headers of logs with right checksums, in part or whole."""


def crafted(folder, header, *frames):
    """Make a log with right checksums."""
    if isinstance(header, dict):
        header = json.dumps({"constants": LAYER.format(""), "kinds": KINDS} | header).encode()
    log = folder / "run.usda.frames"
    log.write_bytes(_MAGIC + b"".join(map(_record, [header, *frames])))
    return log


def content(lengths, a, b):
    return struct.pack("<2I", *lengths) + np.array(a, "<i4").tobytes() + np.array(b, "<f4").tobytes()


GOOD = content([1, 2], [7], [[1, 2, 3], [4, 5, 6]])


class TestCrafted:
    @pytest.mark.parametrize(
        "header", [one for several in CRAFTED.values() for one in several], ids=lambda one: str(one)[:60]
    )
    def test_header(self, tmp_path, header):
        log = crafted(tmp_path, header, GOOD)
        with pytest.raises(
            InputError, match=r"run\.usda\.frames' is (not a log of frames|damaged: )"
        ) as refusal:
            recover(log)
        assert "\n" not in str(refusal.value)
        assert list(tmp_path.iterdir()) == [log]

    @pytest.mark.parametrize(
        "bad",
        [
            b"",
            b"\1",
            GOOD[:-1],
            GOOD + b"\0",
            content([2, 2], [7], [[1, 2, 3], [4, 5, 6]]),
            content([2**32 - 1, 2**32 - 1], [7], [[1, 2, 3], [4, 5, 6]]),
            content([1, 2], [7], [[1, 2, np.nan], [4, 5, 6]]),
            content([1, 2], [7], [[1, np.inf, 3], [4, 5, 6]]),
        ],
    )
    def test_frame(self, tmp_path, bad):
        """The log ends where a frame is none."""
        assert recover(crafted(tmp_path, {}, GOOD, GOOD, bad, GOOD)) == (tmp_path / "run.usda", 2)

    def test_resumed_run(self, tmp_path):
        log = crafted(tmp_path, {"constants": LAYER.format(NESTED)}, GOOD)
        log = log.rename(tmp_path / "run.usdc.frames")
        with pytest.raises(InputError, match="is damaged"):
            recorder_of(tmp_path / "run.usdc", resume_at=1)


class TestNothingIsLost:
    @pytest.mark.parametrize(("suffix", "draw_as", "friction"), FILES)
    def test_recovered_file_has_the_bytes_of_a_finished_one(self, tmp_path, suffix, draw_as, friction):
        run = make_frames(6), make_scene(friction=friction)
        shown = {"draw_as": draw_as, "forces": True}
        log = cut_short(tmp_path / f"run{suffix}", *run, error=ValueError, **shown)
        assert list(tmp_path.iterdir()) == [log]
        recovered, frames = recover(log)
        assert (recovered, frames) == (tmp_path / f"run{suffix}", 6)
        (tmp_path / "whole").mkdir()
        whole = record(tmp_path / "whole" / f"run{suffix}", *run, **shown)
        assert recovered.read_bytes() == whole.read_bytes()

    @pytest.mark.parametrize("count", [0, 1])
    def test_a_block_left_at_the_start_leaves_nothing(self, tmp_path, count):
        cut_short(tmp_path / "run.usdc", make_frames(count))
        assert list(tmp_path.iterdir()) == []

    def test_an_earlier_file_stays_until_the_new_one_is_whole(self, tmp_path):
        path = record(tmp_path / "run.usdc", make_frames(4))
        before = path.read_bytes()
        cut_short(path, make_frames(5), error=ValueError)
        assert path.read_bytes() == before

    @pytest.mark.parametrize("suffix", [*RECORDINGS, ".USDC", ".Usdz"])
    def test_a_whole_file_replaces_an_earlier_one_and_stands_alone(self, tmp_path, suffix):
        path = record(tmp_path / f"run{suffix}", make_frames(4))
        record(path, make_frames(9, seed=1))
        require_frames(path, make_frames(9, seed=1))
        assert list(tmp_path.iterdir()) == [path]

    def test_frames_of_another_run_are_not_touched(self, tmp_path):
        log = cut_short(tmp_path / "run.usdc", make_frames(5))
        before = log.read_bytes()
        with pytest.raises(InputError, match=r"run.usdc.frames' holds frames of another run"):
            recorder_of(tmp_path / "run.usdc")
        assert log.read_bytes() == before

    def test_frames_lost_in_writing_the_file_are_noticed(self, tmp_path, monkeypatch):
        log = cut_short(tmp_path / "run.usdc", make_frames(9))
        write = Sdf.Layer.SetTimeSample

        def forget_one(layer, path, code, value):
            if (path.name, code) != ("velocities", 5):
                write(layer, path, code, value)

        monkeypatch.setattr(Sdf.Layer, "SetTimeSample", forget_one)
        with pytest.raises(OSError, match=re.escape("reads back 8 frames of /World/Grains.velocities, but")):
            recover(log)
        monkeypatch.undo()
        assert list(tmp_path.iterdir()) == [log]
        assert recover(log)[1] == 9

    def test_frames_after_a_damaged_one_are_left_out(self, tmp_path):
        frames = make_frames(12)
        log = cut_short(tmp_path / "run.usdc", frames)
        content = bytearray(log.read_bytes())
        content[ends_of_records(log)[4] + 50] ^= 1
        log.write_bytes(content)
        assert recover(log)[1] == 4
        require_frames(tmp_path / "run.usdc", frames[:4])

    def test_what_a_kill_left_of_an_unfinished_file_is_removed(self, tmp_path):
        frames = make_frames(3)
        log = cut_short(tmp_path / "run.usdc", frames)
        folder = tmp_path / ".draft.run.usdc"
        folder.mkdir()
        for name in ("run.usdc", "run.usdc.a1b2c3"):
            (folder / name).write_bytes(b"half a file")
        recover(log)
        require_frames(tmp_path / "run.usdc", frames)
        assert set(tmp_path.iterdir()) == {log, tmp_path / "run.usdc"}


class TestResume:
    def test_log_of_a_finished_file_is_on_the_disk(self, tmp_path, monkeypatch):
        path = record(tmp_path / "run.usdc", make_frames(3))
        synced = []
        monkeypatch.setattr(files, "sync", synced.append)
        reopen_log(path, log_of(path))
        assert synced[-2:] == [tmp_path / ".draft.run.usdc.frames", tmp_path]
        assert set(tmp_path.iterdir()) == {path, log_of(path)}

    @pytest.mark.parametrize(("suffix", "draw_as", "friction"), FILES)
    def test_continues_a_finished_file(self, tmp_path, suffix, draw_as, friction):
        frames, scene = make_frames(11), make_scene(friction=friction)
        (tmp_path / "whole").mkdir()
        whole = record(tmp_path / "whole" / f"run{suffix}", frames, scene, draw_as=draw_as)
        path = record(tmp_path / f"run{suffix}", frames[:8], scene, draw_as=draw_as)
        with recorder_of(path, scene, resume_at=6, draw_as=draw_as) as recorder:
            for now in [*moments(frames, scene)][6:]:
                recorder.record(now)
        assert inspect_recording(path) == []
        assert path.read_bytes() == whole.read_bytes()

    def test_package_holds_no_time_of_day(self, tmp_path):
        path = record(tmp_path / "run.usdz", make_frames(2))
        with ZipFile(path) as package:
            assert [file.date_time for file in package.infolist()] == [(1980, 1, 1, 0, 0, 0)]

    def test_refuses_a_log_of_fewer_frames(self, tmp_path):
        cut_short(tmp_path / "run.usdc", make_frames(6))
        with pytest.raises(InputError, match="holds 6 of the 7 frames"):
            recorder_of(tmp_path / "run.usdc", resume_at=7)

    @pytest.mark.parametrize("is_finished", [False, True])
    def test_continues_what_another_release_began(self, tmp_path, monkeypatch, is_finished):
        frames, path = make_frames(9), tmp_path / "run.usdc"
        with monkeypatch.context() as patch:
            patch.setattr(warpgrains, "__version__", "0.1.9")
            patch.setattr("warpgrains.usd.stage._SKY", 0.3)  # what is drawn around the grains may change, too
            if is_finished:
                record(path, frames[:6], draw_as="discs")
            else:
                cut_short(path, frames[:6], draw_as="discs")
        with recorder_of(path, draw_as="discs", resume_at=5) as recorder:
            append(recorder, frames[5:])
        assert inspect_recording(path) == []
        assert Usd.Stage.Open(str(path)).GetEndTimeCode() == 8.0

    @pytest.mark.parametrize(
        ("fields", "options"),
        [
            ({"text": "other"}, {}),
            ({"radius": 1.5 * RADIUS}, {}),
            ({"mass": 2.0}, {}),
            ({}, {"color_by": "radius"}),
            ({}, {"forces": True}),
            ({}, {"fps": 25}),
            ({}, {"first_step": 3}),
            ({}, {"draw_as": "spheres"}),
        ],
    )
    def test_refuses_a_log_of_another_scene_or_drawing(self, tmp_path, fields, options):
        cut_short(tmp_path / "run.usdc", make_frames(4), draw_as="discs")
        options = {"draw_as": "discs"} | options
        with pytest.raises(InputError, match="holds frames of another scene"):
            recorder_of(tmp_path / "run.usdc", make_scene(**fields), resume_at=4, **options)

    def test_refuses_what_is_not_there(self, tmp_path):
        with pytest.raises(InputError, match="does not exist"):
            recorder_of(tmp_path / "run.usdc", resume_at=4)
