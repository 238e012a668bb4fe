"""Table, figure and joint values of a compensation."""
