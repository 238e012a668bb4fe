"""Table, figure and report section of moments."""
