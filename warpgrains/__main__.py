"""`python -m warpgrains` is the command `warpgrains`."""

import signal
import sys
from importlib import import_module

signal.signal(signal.SIGINT, signal.SIG_DFL)  # until there is someone to say that it was interrupted


def main() -> int:
    """Run the command line and return its exit code."""
    # Modules at the top of the package stand below its packages: what is above them they import by name.
    command_line = import_module("warpgrains.cli.main")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return int(command_line.main())


if __name__ == "__main__":
    sys.exit(main())
