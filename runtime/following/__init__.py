"""How a stream goes on from one chunk to the next: what it follows, what it carries, and how it ends."""
