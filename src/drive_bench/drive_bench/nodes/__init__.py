"""Node that puts drives through a motion."""
