"""An arm that executes plans: the interface any arm can take, and a simulated one in a physics engine (Section V).

Only `runtime.arm.bullet`, `runtime.arm.mujoco` and `runtime.arm.film` need an extra, `[pybullet]` or `[mujoco]`, and
import it when they are used.
"""
