"""Scenes and their states, with the checks and the readers of scene files."""
