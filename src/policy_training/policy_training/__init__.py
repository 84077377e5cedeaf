"""Trains walking policies with electrical power in the reward, and evaluates them."""

__version__ = '0.1.0'
