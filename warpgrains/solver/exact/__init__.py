"""The exact solution of a step on the host: without friction by active sets, with friction along a path."""
