"""Kernels of packings: grains at random places, moved apart."""
