"""Commands of power_estimator."""
