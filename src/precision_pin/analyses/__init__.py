"""Analyses, one file for each question."""
