"""The plant in real time behind the bus of the hardware."""
