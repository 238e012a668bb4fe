"""Table, figures, verdict and report section of a Monte Carlo run."""
