"""Commands of power_workbench."""
