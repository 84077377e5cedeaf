"""Simulated runs as fast as the machine can, to a bag or to memory."""
