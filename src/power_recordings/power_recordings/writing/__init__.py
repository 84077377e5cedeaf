"""Rosbag2 MCAP bags that survive a killed process and a full disk."""
