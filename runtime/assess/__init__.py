"""What is to be said of a plan: how well it does, how sure that is, and what it keeps to."""
