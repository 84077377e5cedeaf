"""Power of many simulated robots at once, for rewards in training."""
