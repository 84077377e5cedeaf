"""Sound level measurement and its alignment with a recording."""
