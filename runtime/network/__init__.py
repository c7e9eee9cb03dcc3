"""The network: bundles, what it sees of a command, and the decode loop."""
