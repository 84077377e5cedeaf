"""Commands of power_lab."""

from wattwalk_core import early

early.install()
