"""Whether a scene fits in memory: asked before buffers are allocated, not found out by a killed process."""

from pathlib import Path

import warp as wp

from warpgrains.errors import SimulationError


def require_memory(needed: int, grains: int, device: wp.Device) -> None:
    """Refuse what does not fit.

    Parameters
    ----------
    needed : int
        [bytes]
    grains : int
        For how many grains, with the candidate pairs that there is to be room for.
    device : wp.Device

    Raises
    ------
    SimulationError
        They need more memory than the device has free.
    """
    free = free_memory(device)
    if needed > free:
        raise SimulationError(
            f"{grains} grains and their contacts need {needed / 1e9:.2f} GB,"
            f" and {device.alias} has {free / 1e9:.2f} GB free"
        )


def free_memory(device: wp.Device) -> float:
    """Return the free memory of a device [bytes], infinite where it is not told."""
    if device.is_cuda:
        return float(device.free_memory)
    meminfo = Path("/proc/meminfo")
    if not meminfo.exists():
        return float("inf")
    fields = dict(line.split(":") for line in meminfo.read_text().splitlines())
    return 1024.0 * float(fields["MemAvailable"].split()[0])
