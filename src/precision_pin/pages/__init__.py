"""Whole pages: the report and the 3-D view."""
