"""The network in torch, its checkpoints and its weights."""
