"""EtherCAT slaves emulated to the frame, on a raw socket: to test masters without hardware."""
