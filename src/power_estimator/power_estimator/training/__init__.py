"""Training and cross-validation of networks, sweeps of their size, and distillation."""
