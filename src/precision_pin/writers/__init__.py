"""Robots as built and sheets as files."""
