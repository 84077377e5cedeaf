"""Agreement in time of the streams of a recording, and the error of power without it."""
