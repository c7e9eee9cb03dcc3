"""The law of friction, differentiable, and the closed loop through it."""
