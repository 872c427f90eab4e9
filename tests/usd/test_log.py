"""Logs of frames: what a killed run left is recovered or continued, and nothing else is taken for a log."""

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
from warpgrains.base import files
from warpgrains.base.errors import InputError
from warpgrains.base.frame_log import _MAGIC, FrameLog, LogReader, _record
from warpgrains.drawing.kinds import RECORDINGS
from warpgrains.usd.check import inspect_recording
from warpgrains.usd.recorder import log_of, recover
from warpgrains.usd.writer import reopen_log


def cut_short(path, frames, scene=None, **options):
    """Record frames and leave the block by an interrupt; return the log."""

    def frames_until_the_interrupt():
        yield from frames
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        record(path, frames_until_the_interrupt(), scene, **options)
    return log_of(path)


def require_frames(path, frames):
    assert inspect_recording(path) == []
    stage = Usd.Stage.Open(str(path))
    points = grains_of(stage).GetPointsAttr()
    written = np.array([points.Get(code) for code in points.GetTimeSamples()])
    assert np.array_equal(written[:, :, :2], frames[:, 0].astype(np.float32))


class TestLog:
    def test_arrays_are_read_as_written_and_repeated_after_a_failed_flush(self, tmp_path, monkeypatch):
        def fail(file):
            raise OSError(ENOSPC, "no space")

        log = FrameLog(tmp_path / "log", "constants")
        frames = [
            {
                "c": np.full(k % 4, k / 3.0),
                "b": np.full((k % 3, 3), k, np.float32),
                "a": np.full(2, k, np.int32),
            }
            for k in range(101)
        ]
        for frame in frames[:100]:
            log.append(frame)
        with monkeypatch.context() as full:
            full.setattr(os, "fsync", fail)
            with pytest.raises(OSError, match="no space"):
                log.append(frames[100])
        log.append(frames[100])
        reader = LogReader(log.path)
        assert (reader.constants, reader.kinds) == ("constants", {"a": "<i4", "b": "(3,)<f4", "c": "<f8"})
        for ours, theirs in zip(frames, reader, strict=True):
            assert all(np.array_equal(ours[name], theirs[name]) for name in "abc")
            assert all(theirs[name].flags.aligned for name in "abc")

    def test_ends_at_the_first_frame_that_is_cut_off_or_damaged(self, tmp_path):
        log = cut_short(tmp_path / "run.usdc", make_frames(3))
        content, reader = log.read_bytes(), LogReader(log)
        begin, ends = reader.end, [reader.end for _ in reader]
        assert ends[-1] == len(content)
        for place in [*range(begin, len(content), 7), *ends[:-1]]:
            flipped = content[place] ^ 1
            for damaged in (content[:place], content[:place] + bytes([flipped]) + content[place + 1 :]):
                log.write_bytes(damaged)
                assert len(list(LogReader(log))) == sum(end <= place for end in ends)
        log.write_bytes(content[: ends[1] + 50])
        assert recover(log)[1] == 2
        require_frames(tmp_path / "run.usdc", make_frames(3)[:2])

    def test_what_cannot_be_written_leaves_the_log_as_it_was(self, tmp_path):
        frames = make_frames(4)
        with recorder_of(tmp_path / "run.usdc") as recorder:
            for frame in frames[:3]:
                recorder.record(moment(*frame))
            before = recorder.log.read_bytes()
            assert len(list(LogReader(recorder.log))) == 3  # a process that is killed now loses none
            too_large = pytest.raises(OSError, match=r"run.usdc.frames' cannot be written: File too large")
            with too_large, small_disk(len(before) + 50):
                recorder.record(moment(*frames[3]))
            assert recorder.log.read_bytes() == before
            assert recorder.frames == 3
            recorder.record(moment(*frames[3]))
        require_frames(tmp_path / "run.usdc", frames)


LAYER = '#usda 1.0\ndef Points "P" {{ int[] a\n point3f[] b\n {} }}\n'
KINDS = {"/P.a": "<i4", "/P.b": "(3,)<f4"}
NESTED = {"constants": LAYER.format("customData = {" + "dictionary d = {" * 100_000)}
NO_KINDS = ["O", 7, None, "V0", "<U4", "<M8", "(0,)<f4", "(999999999,)<f4", "<f3", "", [], "i4,f4", "|b1"]
OTHER_NAMES = ["/P.c"], ["/P"], ["a b"], [""], ["/P.\xe9"], ["/\xe9.a"]
OTHER_KINDS = ["<f4", "<i8", "<u4", "(3,)<i4", "(1\u0663,)<f4"]
HEADERS = [
    *({"kinds": KINDS | {"/P.a": kind}} for kind in NO_KINDS + OTHER_KINDS),
    *({"kinds": kinds} for kinds in (None, 3, "<f4", ["<f4"])),
    *({"kinds": dict.fromkeys(names, "<i4")} for names in OTHER_NAMES),
    *({"constants": text} for text in (None, 3, "", "#usda 1.0", "\ud800", LAYER[:40])),
    NESTED,
    *(b"", b"7", b"{}", b"[" * 100_000, b'{"a":' * 100_000, b"\xff"),
]
"""Headers of logs with right checksums, in part or whole."""


def crafted(folder, header, *frames, suffix=".usda"):
    """Make a log with right checksums."""
    if isinstance(header, dict):
        header = json.dumps({"constants": LAYER.format(""), "kinds": KINDS} | header).encode()
    log = folder / f"run{suffix}.frames"
    log.write_bytes(_MAGIC + b"".join(map(_record, [header, *frames])))
    return log


def content(lengths, a, b):
    return struct.pack("<2I", *lengths) + np.array(a, "<i4").tobytes() + np.array(b, "<f4").tobytes()


GOOD = content([1, 2], [7], [[1, 2, 3], [4, 5, 6]])


def test_empty_records_are_no_frames(tmp_path):
    """Zeros are records without content: a log whose kinds are none would have one in 12 bytes."""
    log = crafted(tmp_path, {"kinds": {}}, bytes(12 * 1000))
    with pytest.raises(InputError, match="is not a log of frames"):
        recover(log)


class TestCrafted:
    @pytest.mark.parametrize("header", HEADERS, ids=lambda one: str(one)[:60])
    def test_header(self, tmp_path, capfd, header):
        log = crafted(tmp_path, header, GOOD)
        with pytest.raises(
            InputError, match=r"run\.usda\.frames' is (not a log of frames|damaged: )"
        ) as refusal:
            recover(log)
        assert "\n" not in str(refusal.value)
        assert capfd.readouterr() == ("", "")
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
        crafted(tmp_path, NESTED, GOOD, suffix=".usdc")
        with pytest.raises(InputError, match="is damaged"):
            recorder_of(tmp_path / "run.usdc", resume_at=1)


class TestNothingIsLost:
    @pytest.mark.parametrize(
        ("suffix", "draw_as", "friction"),
        [
            *((suffix, "points", 0.0) for suffix in (*RECORDINGS, ".USDC", ".Usdz")),
            *((".usdc", draw_as, 0.3) for draw_as in FORMS),
        ],
    )
    def test_recovered_and_continued_files_have_the_bytes_of_a_whole_one(
        self, tmp_path, suffix, draw_as, friction
    ):
        """And replace an earlier one when they are whole, and what a kill left of one."""
        frames, scene = make_frames(7), make_scene(friction=friction)
        shown = {"draw_as": draw_as, "forces": True}
        (tmp_path / "whole").mkdir()
        whole = record(tmp_path / "whole" / f"run{suffix}", frames, scene, **shown).read_bytes()
        path = record(tmp_path / f"run{suffix}", make_frames(3, seed=1))
        left = tmp_path / f".draft.{path.name}"
        left.mkdir()
        for name in (path.name, "run.usdc.a1b2c3"):
            (left / name).write_bytes(b"half a file")
        log = cut_short(path, frames, scene, **shown)
        assert recover(log) == (path, 7)
        assert path.read_bytes() == whole
        assert inspect_recording(path) == []
        assert {*tmp_path.iterdir()} == {tmp_path / "whole", path, log}
        for resume_at in (5, 3):  # in the log, and in the finished file
            with recorder_of(path, scene, resume_at, **shown) as recorder:
                for now in [*moments(frames, scene)][resume_at:]:
                    recorder.record(now)
            assert path.read_bytes() == whole
            assert {*tmp_path.iterdir()} == {tmp_path / "whole", path}

    def test_without_frames_nothing_is_left(self, tmp_path):
        for count in (0, 1):
            cut_short(tmp_path / "run.usdc", make_frames(count))
        with pytest.raises(ValueError, match="no frame was recorded"):
            record(tmp_path / "run.usdc", [])
        assert list(tmp_path.iterdir()) == []

    def test_an_earlier_file_and_frames_of_another_run_stay(self, tmp_path):
        path = record(tmp_path / "run.usdc", make_frames(4))
        before = path.read_bytes()
        log = cut_short(path, make_frames(5))
        frames = log.read_bytes()
        refusals = []  # which keep what has failed from being collected: it has no lock any more
        for _ in range(2):
            with pytest.raises(InputError, match=r"run.usdc.frames' holds frames of another run") as refusal:
                recorder_of(path)
            refusals.append(refusal)
        assert {each: each.read_bytes() for each in tmp_path.iterdir()} == {path: before, log: frames}

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

    def test_package_holds_no_time_of_day(self, tmp_path):
        with ZipFile(record(tmp_path / "run.usdz", make_frames(2))) as package:
            assert [file.date_time for file in package.infolist()] == [(1980, 1, 1, 0, 0, 0)]

    def test_log_of_a_finished_file_is_on_the_disk(self, tmp_path, monkeypatch):
        path = record(tmp_path / "run.usdc", make_frames(3))
        synced = []
        monkeypatch.setattr(files, "sync", synced.append)
        reopen_log(path, log_of(path))
        assert synced[-2:] == [tmp_path / ".draft.run.usdc.frames", tmp_path]
        assert set(tmp_path.iterdir()) == {path, log_of(path)}


@pytest.fixture(scope="module")
def four_frames(tmp_path_factory):
    return cut_short(tmp_path_factory.mktemp("log") / "run.usdc", make_frames(4), draw_as="discs")


class TestAnotherRun:
    @pytest.mark.parametrize("is_finished", [False, True])
    def test_of_another_release_is_continued(self, tmp_path, monkeypatch, is_finished):
        frames, path = make_frames(9), tmp_path / "run.usdc"
        with monkeypatch.context() as patch:
            patch.setattr(warpgrains, "__version__", "0.1.9")
            patch.setattr("warpgrains.usd.stage._SKY", 0.3)  # what is drawn around the grains may change, too
            (record if is_finished else cut_short)(path, frames[:6], draw_as="discs")
        with recorder_of(path, draw_as="discs", resume_at=5) as recorder:
            for frame in frames[5:]:
                recorder.record(moment(*frame))
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
    def test_of_another_scene_or_drawing_is_refused(self, four_frames, fields, options):
        options, path = {"draw_as": "discs"} | options, four_frames.with_suffix("")
        with pytest.raises(InputError, match="holds frames of another scene"):
            recorder_of(path, make_scene(**fields), resume_at=4, **options)

    def test_with_fewer_frames_is_refused(self, four_frames):
        with pytest.raises(InputError, match="holds 4 of the 5 frames"):
            recorder_of(four_frames.with_suffix(""), draw_as="discs", resume_at=5)
