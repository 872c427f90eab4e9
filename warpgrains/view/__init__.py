"""The page that plays a simulation or a recording in the browser of this machine."""
