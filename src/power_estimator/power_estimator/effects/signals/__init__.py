"""Signals that effects are computed from and fitted on."""
