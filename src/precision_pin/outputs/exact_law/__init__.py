"""Table, figure and report section of an exact law."""
