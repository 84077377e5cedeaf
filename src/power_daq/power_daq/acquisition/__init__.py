"""From bus frames to stamped, published samples."""
