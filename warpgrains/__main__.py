"""Entry point of the command `warpgrains`, also as `python -m warpgrains`."""

import signal
import sys
from importlib import import_module

signal.signal(signal.SIGINT, signal.SIG_DFL)  # until the code that reports an interrupt is imported


def main() -> int:
    """Run the command line and return its exit code."""
    # Top-level modules may not import the packages, which import them; a name at run time is allowed.
    command_line = import_module("warpgrains.cli.main")
    signal.signal(signal.SIGINT, signal.default_int_handler)
    return int(command_line.main())


if __name__ == "__main__":
    sys.exit(main())
