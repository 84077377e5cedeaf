"""Commands of drive_bench."""
