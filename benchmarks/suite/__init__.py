"""The commands that everyone is measured on."""
