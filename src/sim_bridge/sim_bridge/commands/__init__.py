"""Commands of sim_bridge."""
