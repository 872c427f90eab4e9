"""Homeworks of the course: executed in a sandbox, compared with the reference, and diagnosed."""
