"""Learning: losses, optimizer, the trainer."""
