"""PPO, imitation and the run folder."""
