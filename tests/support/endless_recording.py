"""Record frames that are known in advance until the process is killed, the disk is full or all are written.

    python endless_recording.py OUTPUT GRAINS FRAMES COUNTER

The eight bytes of COUNTER always hold how many frames have been recorded.
"""

import sys
from pathlib import Path

import numpy as np
from recordings import moment, recorder_of

from warpgrains.scene.scene import Scene


def scene_of(grains):
    angle = np.linspace(0.0, 6.0, grains)
    position = 1.2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return Scene(position=position, radius=1e-3, mass=1.0, radius_in=0.5, radius_out=2.0)


def frame(number, grains):
    """Position and velocity, shape (2, grains, 2), different in every frame."""
    return np.random.default_rng(number).uniform(-1.5, 1.5, (2, grains, 2))


def main(output, grains, frames, counter):
    scene = scene_of(grains)
    recorder = recorder_of(output, scene)
    with Path(counter).open("wb", buffering=0) as count, recorder:
        for number in range(frames):
            recorder.record(moment(*frame(number, grains), scene))
            count.seek(0)
            count.write(recorder.frames.to_bytes(8, "little"))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
