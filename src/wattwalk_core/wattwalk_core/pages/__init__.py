"""Offline HTML pages: their skeleton and plot style."""
