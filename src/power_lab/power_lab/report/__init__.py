"""Offline HTML pages that tell what the lab found."""
