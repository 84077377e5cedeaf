"""The interfaces of drive_power_msgs."""
