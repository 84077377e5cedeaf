"""Recordings: their card, writing, reading, repair, alignment."""
