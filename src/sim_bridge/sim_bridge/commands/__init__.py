"""Commands of sim_bridge."""

from wattwalk_core import early

early.install()
