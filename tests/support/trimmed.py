"""How much a long test does, and how many cases it has: all, or what WARPGRAINS_EXAMPLES leaves, as in CI."""

import os


def trimmed(many: int) -> int:
    """Return so many examples, or fewer."""
    return min(many, int(os.environ.get("WARPGRAINS_EXAMPLES", many)))
