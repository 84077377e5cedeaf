"""Judges power models: where they fail and which physical effect they miss."""
