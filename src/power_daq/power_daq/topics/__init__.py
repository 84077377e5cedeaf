"""Republishing of a robot's own topics by an import map."""
