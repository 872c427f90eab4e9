"""`warpgrains report`: refuse what cannot be done, measure, and tell where it is written."""

import sys
from argparse import Namespace
from importlib import import_module
from pathlib import Path

from warpgrains.console import start_warp, stdout_kept_clean
from warpgrains.errors import missing_extra
from warpgrains.scene.reader import shipped_scenes
from warpgrains.scene.scene import Scene


def run(arguments: Namespace) -> bool:
    """Measure speed against error of scenes, and print the names of the files that tell of it."""
    try:
        for library in ("matplotlib", "scipy", "clarabel"):
            import_module(library)
    except ModuleNotFoundError as error:
        raise missing_extra("report", error) from error
    scenes = [
        Scene.load(name).replace(on_unconverged="report") for name in arguments.scenes or shipped_scenes()
    ]
    with stdout_kept_clean():
        start_warp()
        from warpgrains.report.report import write_report

        written = write_report(scenes, Path(arguments.output), progress=sys.stderr.isatty())
    print("\n".join(map(str, written)))
    return False
