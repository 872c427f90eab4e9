"""A window on a simulation or a recording: a page that the browser of this machine shows."""
