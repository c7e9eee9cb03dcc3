"""What a user would pick instead of the network: planners of other kinds, measured on the same suite."""
