"""Offline simulation to a bag or to memory."""
