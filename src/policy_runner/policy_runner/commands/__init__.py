"""Commands of policy_runner."""

from wattwalk_core import early

early.install()
