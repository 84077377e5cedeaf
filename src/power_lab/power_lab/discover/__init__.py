"""Effects that no catalogue has: what they depend on, their shape, a formula, a file."""
