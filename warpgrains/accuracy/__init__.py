"""The true error of a step, and exact steps that are computed without the kernels."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from warpgrains.accuracy.error_bound import ErrorBound, certify

__all__ = ["ErrorBound", "certify"]


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in __all__:
        raise AttributeError(f"module 'warpgrains.accuracy' has no attribute {name!r}")
    return getattr(import_module("warpgrains.accuracy.error_bound"), name)
