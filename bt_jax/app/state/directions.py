"""Where a person carries and turns what is in the gripper, by one key at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float

from bt_jax.tasks import Task

__all__ = ["DIRECTIONS", "TURN_STEP", "Direction", "as_seen", "next_turn", "vector"]

Direction = Literal["left", "right", "away", "near", "up", "down"]
DIRECTIONS: tuple[Direction, ...] = ("left", "right", "away", "near", "up", "down")
AROUND: tuple[Direction, ...] = ("away", "left", "near", "right")  # counter-clockwise, as seen from above
TURN_STEP = 15.0  # degrees; its multiples are round angles
NEAR = 0.01  # part of a step by which a round angle may be missed


def vector(task: Task, direction: Direction) -> Float[np.ndarray, "3"]:
    """Return the unit vector of a direction, as seen by a person who faces the robot, in the world."""
    axes: Mapping[str, np.ndarray] = {
        "right": np.array(task.right),
        "left": -np.array(task.right),
        "away": np.array(task.away),
        "near": -np.array(task.away),
        "up": np.array([0.0, 0.0, 1.0]),
        "down": np.array([0.0, 0.0, -1.0]),
    }
    return axes[direction]


def as_seen(direction: Direction, quarter: int) -> Direction:
    """Return the direction that looks like this one once the view has been turned by so many quarters, counter-clockwise as
    seen from above."""
    return AROUND[(AROUND.index(direction) + quarter) % 4] if direction in AROUND else direction


def next_turn(turn: float, way: Literal[-1, 1]) -> float:
    """Return the next round angle [degrees] after a turn, upwards with 1."""
    return way * TURN_STEP * (math.floor(way * turn / TURN_STEP + NEAR) + 1)
