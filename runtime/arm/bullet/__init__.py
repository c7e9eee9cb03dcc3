"""The physics engine pybullet, extra `[pybullet]`."""
