"""Shared base of the packages: errors, commands, nodes, schema, files, pages and plot style."""
