"""Commands of sound_levels."""
