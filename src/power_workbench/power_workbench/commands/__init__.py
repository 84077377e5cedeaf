"""Commands of power_workbench."""

from wattwalk_core import early

early.install()
