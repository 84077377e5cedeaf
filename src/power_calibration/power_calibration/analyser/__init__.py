"""Calibration of one drive against the log of a certified power analyser."""
