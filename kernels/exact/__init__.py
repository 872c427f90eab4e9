"""The exact method: factorizations and the path."""
