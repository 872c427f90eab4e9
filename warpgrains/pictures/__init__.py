"""Pictures and films of grains, drawn by Matplotlib's Agg: without a window, or knowing of a display."""
