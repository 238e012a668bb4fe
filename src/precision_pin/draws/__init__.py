"""Randomness: laws, correlation, formulas of random components, the counter-based generator."""
