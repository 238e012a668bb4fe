"""Mean and covariance of the error of the displaced chain."""
