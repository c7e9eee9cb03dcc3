"""A plan made better by descending its tracking error."""
