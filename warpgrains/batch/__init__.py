"""Many scenes, advanced together."""
