"""Contents of pictures, whichever program draws them: colors, force chains, walls and times of frames."""
