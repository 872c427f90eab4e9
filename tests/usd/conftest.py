import pytest
from pxr import Usd
from recordings import make_frames, record


@pytest.fixture
def stage_of(tmp_path):
    """Return a function that records frames, and opens the file."""

    def opened(frames=1, scene=None, suffix=".usdc", **options):
        frames = make_frames(frames, 5 if scene is None else scene.n)
        return Usd.Stage.Open(str(record(tmp_path / f"run{suffix}", frames, scene, **options)))

    return opened
