"""`python -m warpgrains` is the command `warpgrains`."""

import sys
from importlib import import_module

if __name__ == "__main__":
    # Modules at the top of the package stand below its packages: what is above them they import by name.
    sys.exit(import_module("warpgrains.cli.main").main())
