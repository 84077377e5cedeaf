"""Judges power models against measurements: where they fail and which physical effect they miss."""
