"""Sizes of groups, slices and bundles of work, chosen from the time that earlier ones took."""

GROWTH = 8  # largest ratio of a size to the previous one


def next_size(size: int, seconds: float, wanted: float, most: float, least: int = 1) -> int:
    """Return the size of the next unit of work.

    Parameters
    ----------
    size, seconds
        Size and duration [s] of the last unit.
    wanted
        Intended duration of the next unit [s].
    most, least
        Bounds; if they conflict, `most` counts.
    """
    paced = size * min(GROWTH, wanted / max(seconds, 1e-3))
    return max(1, int(min(max(least, paced), most)))
