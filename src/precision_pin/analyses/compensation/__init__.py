"""Compensation of the constant part of the pose error by corrected joint values."""
