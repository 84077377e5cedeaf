"""Figures and the page of a sound analysis."""
