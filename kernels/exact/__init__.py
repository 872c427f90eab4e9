"""Kernels of the exact method: sparse factors, the dual problem, and the path with friction."""
