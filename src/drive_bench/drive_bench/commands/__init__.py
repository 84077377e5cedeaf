"""Commands of drive_bench."""

from wattwalk_core import early

early.install()
