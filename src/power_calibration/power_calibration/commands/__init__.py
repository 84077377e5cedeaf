"""Commands of power_calibration."""
