"""Sizes of groups of runs, of slices of their steps and of bundles for a cluster, by the time they take."""

GROWTH = 8  # how much larger than the last one the next may be


def next_size(size: int, seconds: float, wanted: float, most: float, least: int = 1) -> int:
    """Return how large the next piece of work is to be.

    Parameters
    ----------
    size, seconds
        The last one's, and the time that it took [s].
    wanted
        The time that the next one is to take [s].
    most, least
        Bounds; `most` comes first.
    """
    paced = size * min(GROWTH, wanted / max(seconds, 1e-3))
    return max(1, int(min(max(least, paced), most)))
