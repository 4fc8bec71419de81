"""What an episode was worth (paper, equation 1)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32, Int8, Int32

from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.world import Array, World, distances, frames, namespace, to_world
from bt_jax.tasks import Task

__all__ = ["WORST_FITNESS", "fitness", "subgoals_missed", "target_distances"]

WORST_FITNESS = -1e6  # of an individual whose simulation diverged


def target_distances(task: Task, world: World) -> Float32[Array, "S targets"]:
    """Return the distance of each target's object from where it should be, metres."""
    objects = np.array([task.box_names.index(target.object) for target in task.targets])
    frame = np.array([task.frames.index(target.frame) for target in task.targets])
    position = np.array([target.position for target in task.targets], np.float32)
    goal = to_world(frames(world, task), frame, position)
    return distances(world.poses[..., objects, :3], goal)


def subgoals_missed(world: World) -> Int32[Array, " S"]:
    """Return the number of the task's subgoals that were not reached."""
    xp = namespace(world.reached)
    return xp.sum(~world.reached, axis=-1, dtype=np.int32)


def fitness(
    task: Task,
    *,
    distance: Float32[Array, "*E"],
    subgoals_missed: Int32[Array, "*E"],
    nodes: Int32[Array, "*E"],
    ending: Int8[Array, "*E"],
) -> Float32[Array, "*E"]:
    """Return the fitness of episodes: `distance` is the sum over the targets [m]."""
    xp = namespace(distance)
    w = task.weights
    cost = np.float32(w.distance) * distance
    cost = cost + np.float32(w.node) * nodes.astype(np.float32)
    cost = cost + np.float32(w.subgoal) * subgoals_missed.astype(np.float32)
    cost = cost + np.float32(w.timeout) * (ending == Ending.TIMEOUT).astype(np.float32)
    cost = cost + np.float32(w.failure) * (ending == Ending.FAILURE).astype(np.float32)
    return xp.where(ending == Ending.BROKEN, np.float32(WORST_FITNESS), -cost)
