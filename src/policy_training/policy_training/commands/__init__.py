"""Commands of policy_training."""
