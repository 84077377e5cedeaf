"""Recordings of any writer, read back whole or as far as they go."""
