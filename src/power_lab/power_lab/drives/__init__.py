"""Real drives that were identified from public logs."""
