"""Commands of power_fleet."""
