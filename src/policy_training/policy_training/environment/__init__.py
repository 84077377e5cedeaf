"""Walking by velocity command as a task for N robots."""
