"""Pictures and films of grains, drawn by Matplotlib's Agg, which needs no window and no display."""
