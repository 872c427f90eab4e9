"""Sweeps of the Gauss-Seidel loop, and when they end."""
