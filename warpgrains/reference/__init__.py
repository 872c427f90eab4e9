"""The reference in C, and how to call it."""
