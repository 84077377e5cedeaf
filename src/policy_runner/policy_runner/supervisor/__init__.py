"""Safety checks and the state machine that runs a policy."""
