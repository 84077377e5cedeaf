"""Measurement of the drives of a robot: bus, clocks, DAQ, supply, recorder and live view."""
