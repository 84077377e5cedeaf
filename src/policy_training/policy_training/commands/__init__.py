"""Commands of policy_training."""

from wattwalk_core import early

early.install()
