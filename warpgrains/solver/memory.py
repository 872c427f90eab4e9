"""Check of free memory before buffers are allocated.

Without it, the operating system would kill a process that uses too much memory, without a message.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import warp as wp

from warpgrains.base.arrays import IndexArray
from warpgrains.base.errors import SimulationError

PROC, CGROUPS = Path("/proc"), Path("/sys/fs/cgroup")
VERSION_1 = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
VERSION_2 = ("memory.max", "memory.current", "inactive_file")
"""Names in control groups of version 2: file with the limit, file with the use, entry of reclaimable memory.

The entry is in the file memory.stat.
"""


class OutOfMemoryError(SimulationError):
    """Lack of memory for scenes that are not loaded yet, or for a longer list of contacts."""


def require_memory(needed: IndexArray, grains: int, device: wp.Device) -> None:
    """Raise OutOfMemoryError if a device lacks the memory that scenes need [bytes], shape (scenes,).

    The message states the total number of grains.
    """
    free, total = free_memory(device), needed.sum()
    if total > free:
        fit = int(np.searchsorted(np.cumsum(needed), free, side="right"))
        raise OutOfMemoryError(
            f"{grains} grains and their contacts need {total / 1e9:.2f} GB,"
            f" and {device.alias} has {free / 1e9:.2f} GB free"
            + (f": the first {fit} of {len(needed)} scenes fit" if len(needed) > 1 else "")
        )


def free_memory(device: wp.Device) -> float:
    """Return the free memory of a device [bytes], infinite if it is unknown.

    On a CPU, limits of the process (ulimit) and of its control groups (Docker, Slurm) count.
    """
    if device.is_cuda:
        return float(device.free_memory)
    host = [1024.0 * float(line.split()[1]) for line in _lines(PROC / "meminfo") if "MemAvailable" in line]
    return max(0.0, min([*host, *_left_to_process(), *_left_to_groups()], default=float("inf")))


def _lines(path: Path) -> list[str]:
    """Return the lines of a file; none if there is no such file."""
    try:
        return path.read_text().splitlines()
    except OSError:
        return []


def _left_to_process() -> Iterator[float]:
    """Yield the memory that each limit of this process (ulimit -v, -d) leaves to it [bytes]."""
    used = dict(line.split(":", 1) for line in _lines(PROC / "self" / "status"))
    for line in _lines(PROC / "self" / "limits"):
        for limit, size in (("Max address space", "VmSize"), ("Max data size", "VmData")):
            if line.startswith(limit) and (most := line.removeprefix(limit).split()[0]) != "unlimited":
                yield float(most) - 1024.0 * float(used[size].split()[0])


def _left_to_groups() -> Iterator[float]:
    """Yield the memory that each control group of this process, and each parent group, leaves to it [bytes].

    A container may see its own group as the root.
    """
    for line in _lines(PROC / "self" / "cgroup"):
        _, controllers, path = line.split(":", 2)
        if controllers and "memory" not in controllers.split(","):
            continue
        root, (most, used, cached) = (CGROUPS / "memory", VERSION_1) if controllers else (CGROUPS, VERSION_2)
        own = root / path.lstrip("/")
        for group in (own, *own.parents):
            limit, now = _lines(group / most), _lines(group / used)
            if limit and now and limit[0] != "max":
                files = dict(line.split() for line in _lines(group / "memory.stat"))
                yield float(limit[0]) - float(now[0]) + float(files.get(cached, 0))
