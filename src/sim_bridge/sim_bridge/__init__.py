"""Simulation of a walking robot and its drives up to the power meter's terminals and a CAN bus."""

__version__ = '0.1.0'
