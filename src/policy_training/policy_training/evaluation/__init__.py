"""Evaluation of policies on tasks, and its report."""
