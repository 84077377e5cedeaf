"""Brings up the nodes of a measured robot as one: launch files, and the command `live`."""
