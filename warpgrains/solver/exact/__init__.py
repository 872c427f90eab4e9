"""The host's solvers of a step: active sets without friction, path following with friction."""
