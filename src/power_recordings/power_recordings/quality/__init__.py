"""Checks of a recording: rates, updates of the electrical signals, units, clipping, coverage."""
