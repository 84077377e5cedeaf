"""Training of walking policies with electrical power in the reward, and their evaluation."""

__version__ = '0.1.0'
