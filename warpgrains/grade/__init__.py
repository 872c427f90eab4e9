"""Homeworks of the course: run in a process of their own, held against the reference, and diagnosed."""
