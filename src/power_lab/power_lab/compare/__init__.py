"""Models against measurements on held-out data, and where they fail."""
