"""Calibration: what measuring an arm will tell, which poses to measure, and the fit of the error model to data."""
