"""Acquisition: stamped, published samples from bus frames."""
