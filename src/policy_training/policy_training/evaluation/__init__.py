"""Policies measured on tasks, and the report."""
