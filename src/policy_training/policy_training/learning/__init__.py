"""PPO and the run folder."""
