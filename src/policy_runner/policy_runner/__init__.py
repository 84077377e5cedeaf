"""Runs walking policies and excitation signals on a robot, safely."""
