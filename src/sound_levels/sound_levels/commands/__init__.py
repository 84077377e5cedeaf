"""Commands of sound_levels."""

from wattwalk_core import early

early.install()
