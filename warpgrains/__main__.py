"""`python -m warpgrains` is the command `warpgrains`."""

import sys

from warpgrains.cli import main

if __name__ == "__main__":
    sys.exit(main())
