"""Law of the largest error along a path, and bands about its whole error curve."""
