"""Nodes: DAQ, supply, recorder and live view."""
