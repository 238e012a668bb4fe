"""Changed robots: the robots to start from, the changes, a second reading, and the trial of one mutant."""
