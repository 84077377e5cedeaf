"""Bounded least squares of effect models."""
