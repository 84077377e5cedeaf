"""Commands of power_calibration."""

from wattwalk_core import early

early.install()
