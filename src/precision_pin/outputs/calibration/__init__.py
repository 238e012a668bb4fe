"""Forecast, plan and result of a calibration: tables and figures."""
