"""Emulated instruments: power analyser, bench supply, EtherCAT terminals."""
