"""Table, figure and report section of a budget."""
