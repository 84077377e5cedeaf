"""Measures the drives of a robot: bus, clocks, DAQ node, recorder, recordings as arrays."""
