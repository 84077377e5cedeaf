"""Commands of power_recordings."""
