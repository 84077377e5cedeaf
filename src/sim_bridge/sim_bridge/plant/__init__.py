"""Simulated robot, drives, circuit and bus."""
