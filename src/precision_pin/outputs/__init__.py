"""Outputs, one file for each medium."""
