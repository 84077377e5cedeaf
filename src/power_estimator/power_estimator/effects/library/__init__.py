"""Shipped physical effects, by kind."""
