"""The table of commands, with one entry per command (`COMMANDS`), and the options of each command."""

import os
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable
from importlib import import_module
from types import NoneType
from typing import Any, NamedTuple, get_args, get_type_hints

from warpgrains.console import exit_on_interrupt
from warpgrains.drawing.kinds import FILM, STILL
from warpgrains.simulation.options import DEFAULT_RATE, FLAGS, OPTIONS, RunOptions


class Command(NamedTuple):
    """A command of the command line."""

    home: str
    """Module of this package and its function, which returns whether the command failed, or an exit code."""
    add_options: Callable[[ArgumentParser], None]
    help: str
    description: str

    def do(self, arguments: Namespace) -> int:
        """Execute the command and return the exit code. The command's module is imported only here."""
        module, _, function = self.home.partition(".")
        if getattr(arguments, "check_bounds", False):
            os.environ["WARPGRAINS_CHECK_BOUNDS"] = "1"  # read when the kernels are imported
        with exit_on_interrupt():
            do = getattr(import_module(f"warpgrains.cli.{module}"), function)
        return int(do(arguments))


def _add_run(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", metavar="SCENE", nargs="?", help="a TOML file, or the name of a shipped scene")
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=int, metavar="N", help="total number of time steps")
    length.add_argument(
        "--duration", type=float, metavar="T", help="total simulated time [s] (default: the scene's)"
    )
    add("--order", metavar="ORDER", help="order of the contacts, sequential or color (default: the scene's)")
    add("--method", metavar="METHOD", help="gauss-seidel, accelerated or exact (default: the scene's)")
    add("--device", default="cpu", help="cpu or cuda:0 (default: cpu)")
    add("--threads", type=int, metavar="K", help="OS threads on a CPU (default: as many as help)")
    add("--check-bounds", action="store_true", help="test every array index in the kernels, to find defects")
    _add_set(parser)
    add("--json", action="store_true", help="print the summary as one JSON object")
    _add_outputs(parser)
    stepping = parser.add_argument_group("step by step").add_argument
    keys = "one step per key press, with its report: N next, R run in real time, S stop, Q quit"
    stepping("--step-by-step", action="store_true", help=keys)
    stepping("--full-speed", action="store_true", help="let R run at full speed instead of real time")
    each = "file for zeta and residual of every iteration, which plot draws"
    stepping("--history", metavar="CSV", help=each)


def _add_outputs(parser: ArgumentParser) -> None:
    """Add the options of `RunOptions`, grouped by the options that they need."""
    titles = {"record": "recording", "measure": "series", "series": "series", "checkpoint": "checkpoints"}
    groups: dict[str, Any] = {title: parser.add_argument_group(title) for title in titles.values()}
    types = get_type_hints(RunOptions)
    for name, flag in FLAGS.items():
        default, option = OPTIONS[name].default, OPTIONS[name].metadata
        group = groups.get(titles.get(option["needs"] or name, ""), parser)
        given: dict[str, Any] = {"dest": name, "help": option["meaning"][0].lower() + option["meaning"][1:-1]}
        (kind,) = set(get_args(types[name]) or [types[name]]) - {NoneType}
        given |= {"action": "store_true"} if kind is bool else {"metavar": option["metavar"], "type": kind}
        if default:
            given["help"] += f" (default: {default})"
        if name == "every":
            given["help"] += f", and two rows of a series (default: {OPTIONS['measure_every'].default})"
        if name == "draw_as":
            group = group.add_mutually_exclusive_group()
            for form in ("points", "spheres"):
                same = {"action": "store_const", "const": form, "help": f"the same as {flag} {form}"}
                group.add_argument(f"{flag}-{form}", dest=name, **same)
        group.add_argument(*["-o"] * (name == "record"), flag, **given)
    left = "continue the run of this checkpoint and its recording; takes the place of SCENE"
    groups["checkpoints"].add_argument("--resume", metavar="FILE", help=left)


def _add_set(parser: ArgumentParser) -> None:
    parser.add_argument(
        "--set",
        action="append",
        dest="overrides",
        metavar="SECTION.KEY=VALUE",
        help="replace a value of the scene, such as physics.drag=0.1; may be repeated",
    )


def _add_scenes(parser: ArgumentParser) -> None:
    kinds = "a TOML file, or the name of a shipped scene: show it, and every key it could have"
    parser.add_argument("scene", metavar="SCENE", nargs="?", help=kinds)


def _add_init(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("file", metavar="FILE", help="the scene to write, a .toml file")
    base = "scene to start from, a TOML file or the name of a shipped one (default: annulus)"
    add("--from", dest="base", metavar="SCENE", default="annulus", help=base)


def _add_batch(parser: ArgumentParser) -> None:
    add = parser.add_argument
    kinds = "a sweep file, a folder of scenes, or the name of a shipped sweep"
    add("sweep", metavar="SWEEP", nargs="?", help=kinds)
    add(
        "-o", "--output", metavar="DIR", required=True, help="folder for results.csv, parts/ and runs/NUMBER/"
    )
    add("--resume", action="store_true", help="continue with the runs that are not finished")
    axes = "x=COLUMN,y=COLUMN[,color=COLUMN]"
    add("--plot", metavar=axes, help="draw the results; without SWEEP, existing ones")
    measure = (
        "quantities to measure at the end of each run, such as coordination,stress: columns of results.csv"
    )
    add("--measure", metavar="WHAT,...", help=measure)
    add(
        "--every",
        type=int,
        metavar="K",
        help="also write series.csv in the folder of each run, a row every K steps",
    )
    until = (
        "end each run early, at rest, as run --until does; column `met` of"
        " results.csv is 1 for a run that came to rest"
    )
    add("--until", metavar="rest", help=until)
    add("--usd", action="store_true", help="record every run to its recording.usdc")
    add(
        "--folders",
        action="store_true",
        help="keep a folder for every run, with its scene, final checkpoint and result",
    )
    add("--fps", type=float, metavar="F", help=f"frames recorded a second (default: {DEFAULT_RATE:g})")
    add("--device", default="cpu", help="cpu or cuda:0 (default: cpu)")
    add("--threads", type=int, metavar="K", help="OS threads on a CPU (default: its cores)")
    group = parser.add_argument_group("many machines, which must all share DIR")
    cluster = group.add_mutually_exclusive_group()
    cluster.add_argument("--scheduler", metavar="ADDRESS", help="dask scheduler, such as tcp://host:8786")
    cluster.add_argument(
        "--slurm",
        type=int,
        metavar="JOBS",
        help="number of dask workers to start with Slurm, configured as dask-jobqueue says",
    )
    group.add_argument(
        "--index", type=int, metavar="I", help="do only one share of the runs: its number, from 0"
    )
    group.add_argument(
        "--count", type=int, metavar="N", help="number of shares that the runs are divided into"
    )


def _add_compress(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", metavar="SCENE", help="a TOML file, or the name of a shipped scene such as jamming")
    add("--pressure", type=float, metavar="P", help="pressure [N/m] (default: the scene's)")
    add("--duration", type=float, metavar="T", help="longest simulated time [s] (default: the scene's)")
    add("-o", "--output", metavar="FILE", help="checkpoint of the packing to write, .npz")
    _add_set(parser)
    add("--json", action="store_true", help="print the results as one JSON object")


def _add_pack(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("scene", metavar="SCENE", help="a TOML file, or the name of a shipped scene such as polydisperse")
    add("--steps", type=int, default=2000, metavar="N", help="largest number of steps (default: 2000)")
    add("--threads", type=int, metavar="K", help="OS threads on a CPU (default: as many as help)")
    kinds = "packing to write: a checkpoint, .npz, for run --resume, or grains, .csv, for a scene file"
    add("-o", "--output", metavar="FILE", help=kinds)
    _add_set(parser)
    add("--json", action="store_true", help="print the results as one JSON object")


def _add_check(parser: ArgumentParser) -> None:
    parser.add_argument("file", metavar="FILE", help="the recording, a USD file")


def _add_recover(parser: ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="the run's log of frames, such as run.usdc.frames")


def _add_plot(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("file", metavar="FILE", help="the recording, a USD file, or the history of a run step by step, a CSV")
    kinds = f"picture ({STILL.listed}) or film ({FILM.listed}; default: FILE with .png)"
    add("-o", "--output", metavar="PNG", help=kinds)
    frames = "frames to draw, from 0; -1 is the last (default: five, evenly spaced)"
    add("--frames", type=_whole_numbers, metavar="N,N,...", help=frames)
    add("--no-curves", dest="curves", action="store_false", help="draw only the frames, without curves")


def _add_export(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("file", metavar="FILE", help="the recording, a USD file")
    add("-o", "--output", metavar="OUT", help="output, .vtkhdf or .pvd (default: FILE with .vtkhdf)")


def _add_view(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("what", metavar="WHAT", help="a scene, or a recording")
    port = "port on 127.0.0.1 (default: 8080, or the next free one)"
    add("--port", type=int, default=8080, metavar="P", help=port)
    add("--homework", metavar="FILE", help="a homework.c to play stage by stage next to the reference")
    _add_set(parser)


def _add_report(parser: ArgumentParser) -> None:
    add = parser.add_argument
    kinds = "TOML files, or names of shipped scenes (default: all without friction)"
    add("scenes", metavar="SCENE", nargs="*", help=kinds)
    add("-o", "--output", metavar="DIR", required=True, help="folder to put the report in")


def _add_grade(parser: ArgumentParser) -> None:
    add = parser.add_argument
    add("homework", metavar="HOMEWORK", nargs="?", help="a homework.c, or a folder of homeworks")
    add("-o", "--output", metavar="CSV", help="table of grades to write; HOMEWORK must be a folder")
    add("--json", action="store_true", help="print the verdict as JSON: an object, or a list for a folder")
    add("--strict", action="store_true", help="require bit-identical results")
    add("--lang", choices=("en", "fr"), default="en", help="language of verdicts (default: en)")
    add("--html", metavar="DIR", help="write a page for each homework, and one for a class, to a folder")
    empty = "write an empty homework, its header and its task, in English and French (default: here)"
    add("--template", metavar="DIR", nargs="?", const=".", help=empty)


def _whole_numbers(text: str) -> list[int]:
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise ArgumentTypeError(f"{text!r} is not a list of whole numbers such as 0,20,-1") from None


COMMANDS = {
    "run": Command("run.run", _add_run, "simulate a scene", "Simulate a scene."),
    "scenes": Command(
        "scenes.scenes",
        _add_scenes,
        "list the shipped scenes, or explain one",
        "List the shipped scenes and sweeps; or show one, and every key with unit and default.",
    ),
    "init": Command(
        "scenes.init",
        _add_init,
        "write a scene file to start from",
        "Write a scene file to start from, with every key explained.",
    ),
    "batch": Command(
        "batch.run",
        _add_batch,
        "run a sweep of scenes",
        "Run all scenes of a sweep; exit code 1: a run failed or is not finished.",
    ),
    "compress": Command(
        "tools.compress",
        _add_compress,
        "compress grains to a jammed packing",
        "Compress the grains of a scene without gravity by a pressure on the outer wall until they rest,"
        " and print packing fraction, contacts and forces.",
    ),
    "pack": Command(
        "tools.pack",
        _add_pack,
        "settle grains to a packing at rest",
        "Let the grains of a scene settle under gravity, strongly damped, until their forces balance,"
        " and print energy, net forces and contacts. The packing rests with the scene's own settings.",
    ),
    "check": Command(
        "tools.check",
        _add_check,
        "check a recording",
        "Check what USD validators do not: time codes, finite values, lengths of"
        " arrays, extents; exit code 1: a problem was found.",
    ),
    "recover": Command(
        "tools.recover",
        _add_recover,
        "recover the recording of a killed run",
        "Make a recording of the frames that a killed run left. To"
        " continue the run instead, use run --resume.",
    ),
    "plot": Command(
        "tools.plot",
        _add_plot,
        "draw frames and curves of a recording",
        "Draw frames of a recording side by side, and energy, height and contacts over time;"
        " or how zeta and residual fall in the steps of a history.",
    ),
    "export": Command(
        "tools.export",
        _add_export,
        "write a recording for ParaView",
        "Write the grains of a recording, and its contacts and forces, as VTK HDF, which ParaView opens.",
    ),
    "view": Command(
        "view.view",
        _add_view,
        "play a scene or a recording in the browser",
        "Serve a page that plays a scene or a recording. Only this machine can open it. Ctrl-C ends it.",
    ),
    "report": Command(
        "tools.report",
        _add_report,
        "measure speed against error",
        "Measure speed against error: tables, CSV and pictures, in some minutes.",
    ),
    "grade": Command(
        "grade.grade",
        _add_grade,
        "grade a homework of the course",
        "Compare a homework with the reference, function by function, and name its mistakes;"
        " exit code 1: it is wrong, 2: it cannot be graded.",
    ),
}
