"""The command line: one module per command, or per few related ones."""
