"""Recordings: written, read back and checked."""
