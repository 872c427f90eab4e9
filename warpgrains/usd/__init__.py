"""Recordings in USD: writing, reading and checking them."""
