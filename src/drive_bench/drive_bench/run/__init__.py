"""A motion run: supervision, recording and check of the recording."""
