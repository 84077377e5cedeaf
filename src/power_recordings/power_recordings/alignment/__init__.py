"""From recordings to aligned datasets on one time base."""
