"""The options of ``warpgrains run``."""

from argparse import ArgumentParser


def add_run(parser: ArgumentParser) -> None:
    """Add those of ``warpgrains run``."""
    add = parser.add_argument
    add("scene", metavar="SCENE", nargs="?", help="a TOML file, or the name of a shipped scene")
    group = parser.add_argument_group("recording")
    recording = group.add_argument
    recording(
        "-o",
        "--output",
        metavar="OUT",
        help="record to this .usdc, .usda or .usdz file, film it (.mp4, .gif, .webp) or draw its end (.png)",
    )
    recording(
        "--fps", type=float, metavar="F", help="frames recorded a second (default: 24, as Blender plays)"
    )
    recording("--color-by", metavar="WHAT", help="speed, pressure, radius or palette (default: speed)")
    recording("--forces", action="store_true", help="draw force chains")
    one_way = group.add_mutually_exclusive_group().add_argument
    forms = "record grains as points, discs or spheres (default: points)"
    one_way("--as", dest="draw_as", metavar="FORM", help=forms)
    for form in ("points", "spheres"):
        same = f"the same as --as {form}"
        one_way(f"--as-{form}", dest="draw_as", action="store_const", const=form, help=same)
    length = parser.add_mutually_exclusive_group()
    length.add_argument("--steps", type=int, metavar="N", help="time steps to simulate in all")
    length.add_argument(
        "--duration", type=float, metavar="T", help="time to simulate in all [s] (default: the scene's)"
    )
    until = "end earlier, at rest: rest[,speed=V][,energy=E][,time=T], see simulation/until.py"
    add("--until", metavar="rest", help=until)
    add("--order", metavar="ORDER", help="order of the contacts, sequential or color (default: the scene's)")
    add("--method", metavar="METHOD", help="gauss-seidel, accelerated or exact (default: the scene's)")
    add("--device", default="cpu", help="cpu or cuda:0 (default: cpu)")
    add("--threads", type=int, metavar="K", help="OS threads on a CPU (default: as many as pay)")
    add("--check-bounds", action="store_true", help="test every array index in the kernels, to find defects")
    add_set(parser)
    stepping = parser.add_argument_group("step by step").add_argument
    keys = "one step per key press, with its report: N next, R run in real time, S stop, Q quit"
    stepping("--step-by-step", action="store_true", help=keys)
    stepping("--full-speed", action="store_true", help="let R run as fast as steps are computed")
    each = "file for zeta and residual of every iteration, which plot draws"
    stepping("--history", metavar="CSV", help=each)
    series = parser.add_argument_group("series").add_argument
    series("--measure", metavar="WHAT,...", help="measure quantities as the run goes, such as energy,stress")
    series("--series", metavar="CSV", help="file for what is measured, a row every K steps")
    checkpoints = parser.add_argument_group("checkpoints").add_argument
    checkpoints("--checkpoint", metavar="FILE", help="save the run to this .npz file as it goes")
    spacing = "time steps between two checkpoints (default: 1000), and two rows of a series (default: 10)"
    checkpoints("--every", type=int, metavar="K", help=spacing)
    left = "continue the run that left this checkpoint, and what it recorded: instead of SCENE"
    checkpoints("--resume", metavar="FILE", help=left)
    add("--json", action="store_true", help="print the summary as one JSON object")


def add_set(parser: ArgumentParser) -> None:
    """Add the option that changes a scene, which other commands have as well."""
    parser.add_argument(
        "--set",
        action="append",
        dest="overrides",
        metavar="SECTION.KEY=VALUE",
        help="replace a value of the scene, such as physics.drag=0.1; may be repeated",
    )
