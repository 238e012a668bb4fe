"""Table, figure and report section of a worst case."""
