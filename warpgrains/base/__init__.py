"""What all rooms need: checks, errors, files, locks, tables, and the start of Warp."""
