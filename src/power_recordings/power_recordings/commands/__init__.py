"""Commands of power_recordings."""

from wattwalk_core import early

early.install()
