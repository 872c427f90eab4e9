"""Parts that all packages use: checks, errors, files, locks, tables, and the start of Warp."""
