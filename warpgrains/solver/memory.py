"""Check of free memory before buffers are allocated.

Without it, the operating system would kill a process that takes too much, with no message.
"""

from pathlib import Path

import warp as wp

from warpgrains.errors import SimulationError


class OutOfMemoryError(SimulationError):
    """Lack of memory for scenes that are not loaded yet, or for a longer list of contacts."""


def require_memory(needed: int, grains: int, device: wp.Device) -> None:
    """Raise OutOfMemoryError if a device lacks the memory for scenes.

    Parameters
    ----------
    needed : int
        Memory [bytes].
    grains : int
        Number of grains, for the message.
    device : wp.Device

    Raises
    ------
    OutOfMemoryError
        More memory is needed than the device has free.
    """
    free = free_memory(device)
    if needed > free:
        raise OutOfMemoryError(
            f"{grains} grains and their contacts need {needed / 1e9:.2f} GB,"
            f" and {device.alias} has {free / 1e9:.2f} GB free"
        )


def free_memory(device: wp.Device) -> float:
    """Return the free memory of a device [bytes], infinite if it is unknown."""
    if device.is_cuda:
        return float(device.free_memory)
    meminfo = Path("/proc/meminfo")
    if not meminfo.exists():
        return float("inf")
    fields = dict(line.split(":") for line in meminfo.read_text().splitlines())
    return 1024.0 * float(fields["MemAvailable"].split()[0])
