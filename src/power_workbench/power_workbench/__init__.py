"""The workbench: the loop of the lab on one page, served to a browser of this machine."""
