"""What a picture shows, whichever program draws it: colors, force chains, walls and times of frames."""
