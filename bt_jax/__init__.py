"""Behavior Trees for pick-and-place: evolved in JAX, simulated in MuJoCo, readable by people."""
