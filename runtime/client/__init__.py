"""Plans and streams from a server, without a network of one's own."""
