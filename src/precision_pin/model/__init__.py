"""The error model: terms at a pose, added up to first order or multiplied out."""
