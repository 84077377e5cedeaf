"""Sound files to levels by policy (Fig. 7 of the paper)."""
