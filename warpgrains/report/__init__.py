"""Speed against error, measured, drawn and written down."""
