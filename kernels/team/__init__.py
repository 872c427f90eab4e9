"""Threads that share a step: its stages, and waiting for one another."""
