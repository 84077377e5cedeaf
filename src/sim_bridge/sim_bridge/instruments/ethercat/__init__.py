"""EtherCAT slaves emulated on a raw socket, to test masters without hardware."""
