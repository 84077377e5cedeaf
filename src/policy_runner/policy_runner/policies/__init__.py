"""Scripted and learned walking policies."""
