"""Motions of single drives, supervised, recorded and checked."""
