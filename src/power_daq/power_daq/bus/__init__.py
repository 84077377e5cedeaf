"""The power board's and drives' CAN FD bus: its description and its interfaces."""
