"""Commands of power_estimator."""

from wattwalk_core import early

early.install()
