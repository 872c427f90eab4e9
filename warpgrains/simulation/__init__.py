"""Simulations of one scene, and runs that write files, save checkpoints and can be resumed."""
