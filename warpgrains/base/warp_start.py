"""Start of Warp, with the settings of this package, and its devices."""

from __future__ import annotations

import sys
from functools import cache
from tempfile import TemporaryFile
from typing import TYPE_CHECKING

from warpgrains.base.console import STDERR, redirected
from warpgrains.base.errors import InputError
from warpgrains.base.turns import BUILDING

if TYPE_CHECKING:
    import warp

NO_DRIVER = "Could not find or load the NVIDIA CUDA driver"


def start_warp() -> None:
    """Initialize Warp without its banner and messages, unless its `log_level` has been set."""
    with BUILDING:
        _start_warp()


@cache
def _start_warp() -> None:
    import warp

    if warp.config.log_level == warp.LOG_INFO:
        warp.config.log_level = warp.LOG_WARNING
    warp.config.use_precompiled_headers = False  # slower if only one kernel is compiled
    with TemporaryFile() as remarks:
        try:
            with redirected(STDERR, remarks.fileno()):
                warp.init()
        except OSError as error:
            raise unwritable_cache(error) from error
        remarks.seek(0)
        for remark in remarks.read().decode(errors="replace").splitlines():
            if NO_DRIVER not in remark:
                print(remark, file=sys.stderr)


def unwritable_cache(error: OSError, folder: str = "") -> OSError:
    """Return an error for users, which says that the cache of compiled kernels cannot be written.

    Its message quotes the reason, `error`, and the folder of the cache, if given.
    """
    return OSError(
        f"the cache of compiled kernels{folder and f' in {folder!r}'} cannot be written ({error}):"
        " set WARP_CACHE_PATH to a writable folder"
    )


def find_device(name: str) -> warp.Device:
    """Return a Warp device by its name; raise InputError if there is none."""
    start_warp()
    import warp

    try:
        with (
            TemporaryFile() as remarks,
            redirected(STDERR, remarks.fileno()),
        ):  # Warp reports that the driver is missing
            return warp.get_device(name)
    except (ValueError, RuntimeError) as error:
        known = [device.alias for device in warp.get_devices()]
        told = f"choose one of {', '.join(known)}" if len(known) > 1 else "Warp finds no GPU, so choose cpu"
        raise InputError(f"device {name!r} does not exist: {told}") from error
