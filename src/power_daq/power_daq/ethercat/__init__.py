"""EtherCAT terminals that measure the supply of drives: mapping, segment, acquisition."""
