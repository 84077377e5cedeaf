"""Node and command that put drives through a motion."""
