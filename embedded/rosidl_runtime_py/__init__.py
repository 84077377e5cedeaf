"""Interfaces by their names."""
