"""`warpgrains check`, `recover` and `plot`: what is done with recordings."""

from argparse import Namespace
from importlib import import_module
from pathlib import Path

from warpgrains.cli.apart import done_apart
from warpgrains.errors import missing_extra


def check(arguments: Namespace) -> bool:
    """Print what is wrong with a recording, a line a problem."""
    problems = done_apart("inspect", arguments.file)
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
        import_module("matplotlib.axes")
    except ModuleNotFoundError as error:
        raise missing_extra("plot", error) from error
    output = arguments.output or str(Path(arguments.file).with_suffix(".png"))
    given = {"output": output, "frames": arguments.frames, "curves": arguments.curves}
    numbers = done_apart("draw", arguments.file, **given)
    print(f"{output}: frame{'s' * (len(numbers) > 1)} {', '.join(map(str, numbers))}")
    return False
