"""Warp's cache of compiled kernels: loading what it holds, and compiling the rest."""

import os
import shutil
import threading
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any
from warnings import warn

import warp as wp

from warpgrains.base.turns import BUILDING
from warpgrains.base.warp_start import unwritable_cache

ROOM = 4 * 2**20  # free bytes needed on the disk; the largest module takes 1.3 MB


def is_cached(module: wp.Module, block: int) -> bool:
    """Return True if the cache holds the compiled module for blocks of `block` threads."""
    with BUILDING:
        return _folder(module, block).is_dir()


def load(module: Any, device: wp.Device, block: int) -> None:
    """Load or compile a module for blocks of `block` threads; replace damaged files, with a warning."""
    with BUILDING:
        folder, is_damaged = _folder(module, block), False
        if folder.is_dir():
            try:
                module.load(device, block)
                return
            except OSError:  # kernels for another processor are compiled into the same folder
                pass
            except Exception:  # Warp raises Exception itself, or an error of the JSON parser
                is_damaged = True
        draft = f"{folder}_p{os.getpid()}_t{threading.get_ident()}"  # Warp leaves this folder if it fails
        try:
            if is_damaged:
                warn(f"the compiled kernels in '{folder}' are damaged: compiling them again", stacklevel=2)
                with suppress(FileNotFoundError):  # another process was faster
                    folder.rename(draft)
                shutil.rmtree(draft, ignore_errors=True)
            with TemporaryFile(dir=wp.config.kernel_cache_dir) as file:
                file.write(bytes(ROOM))  # if the disk is full, LLVM ends the process
            module.load(device, block)
        except OSError as error:
            shutil.rmtree(draft, ignore_errors=True)
            raise unwritable_cache(error, wp.config.kernel_cache_dir) from error


def _folder(module: Any, block: int) -> Path:
    return Path(wp.config.kernel_cache_dir) / module.get_module_identifier(block)
