"""Batches: many scenes advanced together."""
