"""Recordings with a hidden effect, and the simulated bench."""
