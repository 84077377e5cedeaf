"""Command of the bring-up."""
