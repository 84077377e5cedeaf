"""The CAN bus of the drives: its description (DBC and mapping), its interfaces, its decoding."""
