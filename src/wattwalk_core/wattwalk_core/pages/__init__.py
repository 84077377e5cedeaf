"""Offline HTML pages: their bones, and the looks of their plots."""
