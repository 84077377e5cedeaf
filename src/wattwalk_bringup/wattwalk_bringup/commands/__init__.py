"""Command of the bring-up."""

from wattwalk_core import early

early.install()
