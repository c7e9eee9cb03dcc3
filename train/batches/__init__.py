"""Batches: commands, starts, disturbances."""
