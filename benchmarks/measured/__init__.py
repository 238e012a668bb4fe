"""Measured robots: forecast, calibration and the error at unseen poses, ``python -m benchmarks.measured FOLDER``."""
