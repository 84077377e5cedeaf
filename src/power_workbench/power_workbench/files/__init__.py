"""Files that a session reads and keeps: recordings, logs, arrays."""
