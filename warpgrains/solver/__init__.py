"""The host's part of a time step: memory, launches, lists that grow, exact solutions and statistics."""
