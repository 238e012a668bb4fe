"""Analyses of the pose error, one folder each."""
