"""An arm that executes plans: the interface any arm can take, and a simulated one in pybullet (Section V).

Only `runtime.arm.simulation` and `runtime.arm.video` need the extra `[pybullet]`, and import it when they are used.
"""
