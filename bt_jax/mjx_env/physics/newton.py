"""MuJoCo's constraint problem for free rigid bodies, solved with a fixed number of Newton steps.

The accelerations `a` minimize `(a - a0)' M (a - a0) / 2 + sum_i D_i min(J_i a - r_i, 0)^2 / 2`, with `r` the
reference accelerations of the contacts' pyramid edges (MuJoCo documentation, "Computation", constraint model). MJX's
solver is made for any mechanism: two nested loops that run until the slowest problem of a batch has converged. Here M
is diagonal and the number of steps fixed, so a step is a few dense products.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float32

__all__ = ["free_accelerations", "solve"]

SEARCH_STEPS = 6


def free_accelerations(
    mass: Float32[Array, "B 6"], gravity: Float32[Array, "3"], velocities: Float32[Array, "B 6"]
) -> Float32[Array, "B 6"]:
    """Return a0, the accelerations of bodies that touch nothing: gravity, and dw/dt of the angular velocity w by Euler's
    equations, I dw/dt = -w x I w. `mass` is M's diagonal; what is linear is in the world, what is angular in the body's
    frame."""
    inertia, spin = mass[:, 3:], velocities[:, 3:]
    linear = jnp.broadcast_to(gravity, velocities[:, :3].shape)
    return jnp.concatenate([linear, -jnp.cross(spin, inertia * spin) / inertia], axis=1)


def solve(
    mass: Float32[Array, " dofs"],
    free: Float32[Array, " dofs"],
    jacobian: Float32[Array, "rows dofs"],
    stiffness: Float32[Array, " rows"],
    reference: Float32[Array, " rows"],
    start: Float32[Array, " dofs"],
    *,
    iterations: int,
) -> Float32[Array, " dofs"]:
    """Return accelerations. `mass` is M's diagonal, `free` is a0, `jacobian` J, `stiffness` D and `reference` r;
    `start` is a first guess."""
    # In units where M is the identity, float32 is enough for heavy and light bodies alike.
    root = jnp.sqrt(mass)
    rows = jacobian / root[None]
    target = free * root

    def cost(a):
        return 0.5 * jnp.sum((a - target) ** 2) + 0.5 * jnp.sum(stiffness * jnp.minimum(rows @ a - reference, 0.0) ** 2)

    def step(_, a):
        gap = rows @ a - reference
        active = jnp.where(gap < 0, stiffness, 0.0)
        gradient = (a - target) + rows.T @ (active * gap)
        hessian = jnp.eye(len(a), dtype=a.dtype) + (rows.T * active[None]) @ rows
        factor = jax.scipy.linalg.cho_factor(hessian, lower=True)
        direction = -jax.scipy.linalg.cho_solve(factor, gradient)
        return a + _search(a - target, gap, direction, rows @ direction, stiffness) * direction

    guesses = jnp.stack([start * root, target])
    costs = jnp.stack([cost(guesses[0]), cost(guesses[1])])
    first = jnp.where(costs[0] < costs[1], guesses[0], guesses[1])
    return jax.lax.fori_loop(0, iterations, step, first) / root


def _search(
    offset: Float32[Array, " dofs"],
    gap: Float32[Array, " rows"],
    direction: Float32[Array, " dofs"],
    slope: Float32[Array, " rows"],
    stiffness: Float32[Array, " rows"],
) -> Float32[Array, ""]:
    """Search the line exactly: return the root of the piecewise linear, increasing derivative of the cost along
    `direction`, by Newton steps kept inside a shrinking bracket."""
    constant, linear = jnp.dot(offset, direction), jnp.dot(direction, direction)

    def derivative(alpha):
        at = gap + alpha * slope
        active = jnp.where(at < 0, stiffness, 0.0)
        return constant + alpha * linear + jnp.dot(active * at, slope), linear + jnp.dot(active, slope**2)

    def step(_, bracket):
        low, high, alpha = bracket
        first, second = derivative(alpha)
        low, high = jnp.where(first < 0, alpha, low), jnp.where(first < 0, high, alpha)
        newton = alpha - first / jnp.maximum(second, 1e-20)
        inside = (newton >= low) & (newton <= high)
        return low, high, jnp.where(inside, newton, 0.5 * (low + jnp.minimum(high, 4.0)))

    zero = jnp.zeros_like(constant)
    return jax.lax.fori_loop(0, SEARCH_STEPS, step, (zero, zero + 1e6, zero + 1.0))[2]
