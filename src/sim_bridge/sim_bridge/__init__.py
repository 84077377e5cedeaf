"""A walking robot and its drives, simulated to the power meter's terminals, behind a CAN bus."""

__version__ = '0.1.0'
