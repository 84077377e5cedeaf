"""Import of logs that others recorded: readers, maps, units, conversion to a recording."""
