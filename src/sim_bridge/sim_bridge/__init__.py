"""A walking robot and its drives, simulated to the terminals of the power meter, behind the CAN bus of the hardware."""
