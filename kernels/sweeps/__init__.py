"""Sweeps of the Gauss-Seidel loop, and the rules by which they end."""
