"""How the drawn gripper holds an object: which way the fingers close, how wide they are open and how high they are."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import mujoco
import numpy as np
from jaxtyping import Float

from bt_jax.mjx_env.scene.mjcf import PAD, PALM, gripper_unit
from bt_jax.tasks import Object, Task

__all__ = ["Grasp", "grasps"]

DIRECTIONS = 8  # in which the fingers may close on a cylinder
MARGIN = 0.02  # between the pads and what the object stands on, in units of the gripper


@dataclasses.dataclass(frozen=True)
class Grasp:
    """The fingers close along `yaw` [rad, about z] until they are `width` [m] apart, `lift` [m] over the object's centre."""

    yaw: float
    width: float
    lift: float


def grasps(task: Task, thing: Object, pose: Float[np.ndarray, "7"]) -> list[Grasp]:
    """Return the grasps of an object along level pairs of parallel faces that fit the opening, the narrowest first; along
    all of them if none fits."""
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.asarray(pose[3:], float))
    axes = matrix.reshape(3, 3).T
    half = float(np.abs(axes[:, 2]) @ np.array(thing.size)) / 2
    unit = gripper_unit(task)
    # The pads stay over what a flat object lies on, and the palm over a tall one.
    lift = max(0.0, (PAD + MARGIN) * unit - half, half - (PALM - MARGIN) * unit)
    found = sorted((Grasp(yaw, width, lift) for yaw, width in _pairs(thing, axes)), key=lambda grasp: grasp.width)
    return [grasp for grasp in found if grasp.width <= task.gripper_opening] or found


def _pairs(thing: Object, axes: Float[np.ndarray, "3 3"]) -> Iterator[tuple[float, float]]:
    """Yield direction and distance of pairs of faces that are nearly level; `axes` are the object's own in the world."""
    if thing.shape == "cylinder":
        stands = abs(axes[2, 2]) > math.sqrt(0.5)
        across = math.atan2(axes[2, 1], axes[2, 0]) + math.pi / 2
        yaws = [math.pi * k / DIRECTIONS for k in range(DIRECTIONS)] if stands else [across]
        yield from ((yaw, thing.size[0]) for yaw in yaws)
        return
    for index in sorted(range(3), key=lambda i: abs(axes[i, 2]))[:2]:
        yield math.atan2(axes[index, 1], axes[index, 0]), thing.size[index]
