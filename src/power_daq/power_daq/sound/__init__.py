"""How loud a robot is: sound files to levels over time, statistics and comparisons."""
