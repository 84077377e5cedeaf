"""Robot, drives, circuit and bus, simulated."""
