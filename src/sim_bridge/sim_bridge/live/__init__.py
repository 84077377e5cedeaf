"""Real-time simulation behind the bus of the hardware."""
