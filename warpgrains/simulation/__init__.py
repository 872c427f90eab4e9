"""One scene, step by step, and runs that can be resumed."""
