"""`warpgrains check`, `recover` and `plot`: what is done with recordings."""

from argparse import Namespace
from pathlib import Path

from warpgrains.errors import missing_extra


def check(arguments: Namespace) -> bool:
    """Print what is wrong with a recording, a line a problem."""
    from warpgrains.usd.check import inspect_recording

    problems = inspect_recording(arguments.file)
    for problem in problems or ["nothing is wrong"]:
        print(f"{arguments.file}: {problem}")
    return bool(problems)


def recover(arguments: Namespace) -> bool:
    """Make a file of the frames that a killed run left."""
    from warpgrains.usd.recorder import recover

    path, frames = recover(arguments.folder)
    print(f"{path}: {frames} frames")
    return False


def plot(arguments: Namespace) -> bool:
    """Draw a recording."""
    try:
        from warpgrains.analysis.plots import plot
    except ModuleNotFoundError as error:
        raise missing_extra("plot", error) from error
    output = arguments.output or str(Path(arguments.file).with_suffix(".png"))
    numbers = plot(arguments.file, output, arguments.frames, arguments.curves)
    print(f"{output}: frame{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}")
    return False
