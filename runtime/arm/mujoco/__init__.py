"""The physics engine MuJoCo, extra `[mujoco]`."""
