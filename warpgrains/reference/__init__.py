"""The course's reference program in C, and its interface to Python."""
