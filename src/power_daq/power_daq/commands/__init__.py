"""Commands of the package: they parse arguments, then import and run a node."""

from wattwalk_core import early

early.install()
