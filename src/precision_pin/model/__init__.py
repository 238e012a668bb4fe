"""The error model: the terms at a pose, added to first order or multiplied exactly."""
