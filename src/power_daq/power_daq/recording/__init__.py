"""Recordings: the bag writer, the card, reading back, and alignment."""
