"""Power meter and sensors of the simulated robot."""
