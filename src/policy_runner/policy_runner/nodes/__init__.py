"""Node that runs a policy on the robot."""
