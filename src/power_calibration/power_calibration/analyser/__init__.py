"""What a certified instrument says: its log, where it lies in time, and what it makes of ours."""
