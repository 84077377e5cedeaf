"""Fixtures of the tests of a package."""

from simulated_leg import bag  # noqa: F401
