"""Randomness: laws, correlation, formulas of random numbers, the counter-based generator."""
