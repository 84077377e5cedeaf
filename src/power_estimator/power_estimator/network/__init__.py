"""The Power Prediction Network: training, checkpoints, inference."""
