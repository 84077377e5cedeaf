"""Residual structure: what diagnosis and discovery examine it with."""
