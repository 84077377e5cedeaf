"""Measured and modelled power as the page draws it."""
