"""One function for many tasks: in this process, on all cores, or on a cluster of machines."""
