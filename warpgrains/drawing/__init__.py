"""Contents of pictures for any program that draws them: colors, force chains, walls and times of frames."""
