"""Coefficients of one model over many recordings, and which of them change."""
