"""The friction of a pan and an object, found in a log of how the one moved and the other slid."""
