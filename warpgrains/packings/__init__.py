"""Packings: grains that fall to rest, and that walls compress until they jam, or that are moved apart."""
