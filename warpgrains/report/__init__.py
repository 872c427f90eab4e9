"""The report on speed against error: its measurements, figures and tables."""
