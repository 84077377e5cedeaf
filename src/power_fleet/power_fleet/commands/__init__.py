"""Commands of power_fleet."""

from wattwalk_core import early

early.install()
