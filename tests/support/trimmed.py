"""How much a long test does: what it is meant to, or what WARPGRAINS_EXAMPLES leaves of it, as in CI."""

import os


def trimmed(many: int) -> int:
    """Return so many examples, or fewer."""
    return min(many, int(os.environ.get("WARPGRAINS_EXAMPLES", many)))
