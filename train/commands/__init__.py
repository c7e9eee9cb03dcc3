"""Commands to train on."""
