"""The device side: Warp kernels and functions, imported as ``warpgrains.kernels``."""
