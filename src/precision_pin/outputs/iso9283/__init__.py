"""Outputs of the forecast by ISO 9283."""
