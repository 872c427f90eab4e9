"""Packings: grains that settle under gravity, that walls compress until they jam, or that are moved apart."""
