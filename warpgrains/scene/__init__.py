"""Scenes and their states: described, read and checked."""
