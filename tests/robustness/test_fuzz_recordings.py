"""Damaged and foreign recordings: one line or a right result, nothing else. More of it with -m slow."""

import subprocess
import zlib
from collections import Counter
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from changed_bytes import mutations, reworded_texts
from command import answer
from forks import ForkServer
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import make_frames, record
from test_foreign_recordings import FOREIGN
from trimmed import trimmed

from warpgrains.cli import sandboxed
from warpgrains.drawing.kinds import RECORDINGS

BY_PLOT, BY_THE_REAL_COMMAND = 20, 200  # every so many files


@cache
def recordings():
    """Return suffix and content of recordings of every kind."""
    with TemporaryDirectory() as folder:
        drawings = [(".usdc", "discs"), (".usdz", "discs"), (".usda", "points"), (".usdc", "spheres")]
        paths = [Path(folder, f"{draw_as}{suffix}") for suffix, draw_as in drawings]
        for path in paths:
            drawn = {"forces": True, "color_by": "pressure"} if path.suffix == ".usdc" else {}
            record(path, make_frames(2), draw_as=path.stem, **drawn)
        return [(path.suffix, path.read_bytes()) for path in paths]


@st.composite
def usd_files(draw):
    """Return the suffix and the content of a file that is damaged or foreign."""
    foreign = [(".usda", text.encode()) for text in FOREIGN.values()]
    suffix, content = draw(st.sampled_from(recordings()) | st.sampled_from(foreign))
    if suffix == ".usda" and draw(st.integers(0, 3)):
        return suffix, draw(reworded_texts(content.decode()))
    return draw(st.sampled_from([suffix] * 9 + [*RECORDINGS])), draw(mutations(content))


@pytest.mark.parametrize("count", [20, pytest.param(trimmed(10_000), marks=pytest.mark.slow)])
def test_recordings(count, capfd, monkeypatch):
    """`check`, and of a share of them `plot`; of some, forks and the real command say the same."""

    def check(example):
        suffix, content = example
        kind = zlib.crc32(content)
        with TemporaryDirectory() as folder:
            path, picture = Path(folder, f"run{suffix}"), Path(folder, "run.png")
            path.write_bytes(content)
            answers = {"check": answer(capfd, "check", path)}
            assert list(Path(folder).iterdir()) == [path]
            if kind % BY_PLOT == 0:
                answers["plot"] = answer(capfd, "plot", path)
                assert picture.exists() == (answers["plot"][0] == 0)
                picture.unlink(missing_ok=True)
            if kind % BY_THE_REAL_COMMAND == 0:
                with monkeypatch.context() as real:
                    real.setattr(sandboxed.subprocess, "run", run)
                    assert answers == {command: answer(capfd, command, path) for command in answers}
                picture.unlink(missing_ok=True)
            seen.update((command, code) for command, (code, *_) in answers.items())
            assert list(Path(folder).iterdir()) == [path]
            assert path.read_bytes() == content

    run, seen = subprocess.run, Counter()
    quiet = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None}
    with ForkServer() as forks, monkeypatch.context() as patch:
        patch.setattr(sandboxed.subprocess, "run", forks.run)
        settings(max_examples=count, derandomize=count < 100, **quiet)(given(usd_files())(check))()
    print(*sorted(seen.items()))
    assert count < 100 or {(how, code) for how in ("check", "plot") for code in (0, 2)} <= seen.keys()
