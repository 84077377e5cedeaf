"""Index of recordings: what was worked out of them, kept for the next run."""
