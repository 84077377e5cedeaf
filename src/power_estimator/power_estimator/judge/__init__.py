"""Scores of power models: on which samples, held out how, and against what."""
