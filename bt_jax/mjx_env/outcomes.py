"""Outcomes as numbers: what a leaf returns in a state, the command that it runs, and the subgoals that it reaches."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32

from bt_jax.mjx_env.world import Array

__all__ = ["ACTION", "COMMAND_BITS", "MAX_COMMANDS", "MAX_SUBGOALS", "SUBGOAL_BITS", "command_of", "subgoals_of"]

# An outcome is subgoals << SUBGOAL_BITS | command << COMMAND_BITS | status, with one bit for each subgoal that it reaches.
COMMAND_BITS, SUBGOAL_BITS = 2, 16
MAX_COMMANDS, MAX_SUBGOALS = 1 << (SUBGOAL_BITS - COMMAND_BITS), 31 - SUBGOAL_BITS
ACTION = np.int32((1 << SUBGOAL_BITS) - 1)  # an outcome without its subgoals


def command_of(outcome: Int32[Array, "*S"]) -> Int32[Array, "*S"]:
    """Return the number of the command that runs; 0 where none does."""
    return outcome >> COMMAND_BITS & np.int32(MAX_COMMANDS - 1)


def subgoals_of(outcome: Int32[Array, "*S"]) -> Int32[Array, "*S"]:
    """Return the subgoals that count as reached from now on, as bits."""
    return outcome >> SUBGOAL_BITS
