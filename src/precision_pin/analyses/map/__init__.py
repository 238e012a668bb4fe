"""The first-order model over many poses: maps, covariance between poses, relative accuracy."""
