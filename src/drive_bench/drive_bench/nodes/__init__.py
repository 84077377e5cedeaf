"""Node that executes a motion."""
