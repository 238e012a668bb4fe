"""What is shown of a Monte Carlo run."""
