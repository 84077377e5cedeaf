"""Commands of the package: they parse arguments, then import and run a node."""
