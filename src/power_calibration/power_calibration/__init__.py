"""Calibration against a reference instrument, and synchronisation of streams."""
