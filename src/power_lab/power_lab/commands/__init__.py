"""Commands of power_lab."""
