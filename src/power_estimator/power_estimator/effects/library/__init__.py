"""Shipped physical effects, one class per file."""
