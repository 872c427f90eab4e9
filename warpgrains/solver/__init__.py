"""One time step, on its device."""
