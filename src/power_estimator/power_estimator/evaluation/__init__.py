"""Evaluation of power models on held-out data."""
