"""Commands of policy_runner."""
