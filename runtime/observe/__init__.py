"""Where pan and object are, from readings that come late, seldom and noisy, and what the friction is."""
