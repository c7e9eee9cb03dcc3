"""Arms that hold the pan: what they are, where they hold it, and how their joints move along a plan."""
