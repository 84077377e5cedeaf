"""Measures the drives of a robot: bus drivers, clock mapping, the DAQ node, the recorder and aligned reading of recordings."""
