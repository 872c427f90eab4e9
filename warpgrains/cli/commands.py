"""What the subcommands do. Each returns whether something is wrong; heavy imports wait until one runs."""

from argparse import Namespace
from pathlib import Path

from warpgrains.errors import missing_extra


def run(arguments: Namespace) -> bool:
    """Simulate a scene, or what is left of a run, record it if asked to, and print a summary."""
    from warpgrains.cli.run import run_command

    return run_command(arguments)


def batch(arguments: Namespace) -> bool:
    """Carry out the runs of a sweep; whether some failed or are not finished."""
    from warpgrains.cli.batch import run

    return run(arguments)


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


def report(arguments: Namespace) -> bool:
    """Measure speed against error of scenes, and print the names of the files that tell of it."""
    from warpgrains.cli.report import report

    return report(arguments)
