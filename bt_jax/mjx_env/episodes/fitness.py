"""What an episode was worth (paper, equation 1)."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
from jaxtyping import Bool, Float32, Int, Int8, Int32

from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.predicates import is_upright, turn_error
from bt_jax.mjx_env.world import Array, World, distances, frames, namespace, to_world
from bt_jax.tasks import Task

__all__ = ["WORST_FITNESS", "Misses", "fitness", "subgoals_missed", "target_misses"]

WORST_FITNESS = -1e6  # of an individual whose simulation diverged
IMPOSSIBLE = np.float32(1e9)  # cost of an instance that is the frame of the target


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Misses:
    """How far the targets of a task are from being met in S states (NumPy)."""

    distance: Float32[np.ndarray, "*S targets"]  # metres, of the object from where it should be
    turn: Float32[np.ndarray, "*S targets"]  # radians, of the object from how it should lie; 0 where any turn will do
    met: Bool[np.ndarray, "*S targets"]  # both within the tolerances, and the object stands upright and is not held


def target_misses(task: Task, world: World) -> Misses:
    """Return how far each target is from being met, with the instances of each part assigned to its targets so that they
    cost least (Kuhn 1955). An instance is never assigned to a place in its own frame."""
    instances = task.instances
    candidates = [np.array([task.object_names.index(name) for name in instances[t.object]]) for t in task.targets]
    poses_of_frames = frames(world, task)
    frame = np.array([task.frames.index(target.frame) for target in task.targets])
    goal = to_world(poses_of_frames, frame, np.array([target.position for target in task.targets], np.float32))
    wanted = np.array([math.nan if t.turn is None else math.radians(t.turn) for t in task.targets], np.float32)
    symmetry = np.array([math.radians(thing.symmetry) for thing in task.objects], np.float32)
    first = np.array([own[0] for own in candidates])

    def misses(own: Int[np.ndarray, "*S targets"]) -> tuple[np.ndarray, np.ndarray]:
        poses = world.poses[..., own, :] if own.ndim == 1 else np.take_along_axis(world.poses, own[..., None], axis=-2)
        turned = np.zeros(goal.shape[:-1], np.float32)
        if not np.isnan(wanted).all():
            error = turn_error(poses[..., 3:], poses_of_frames[..., frame, 3:], wanted, symmetry[own])
            turned = np.where(np.isnan(wanted), np.float32(0), np.abs(error))
        return distances(poses[..., :3], goal), turned

    chosen = first
    if any(len(own) > 1 for own in candidates):
        # SciPy's optimizers take long to import, and tasks without parts do without them.
        from scipy.optimize import linear_sum_assignment

        chosen = np.tile(first, (len(goal), 1))
        weights = task.weights
        for part in dict.fromkeys(target.object for target in task.targets if len(instances[target.object]) > 1):
            at = np.array([i for i, target in enumerate(task.targets) if target.object == part])
            own = candidates[at[0]]
            each = [misses(np.where(np.isin(np.arange(len(first)), at), one, first)) for one in own]
            cost = np.stack([weights.distance * away + weights.turn * turned for away, turned in each], axis=-2)[
                ..., at
            ]
            cost = np.where(own[:, None] == frame[at], IMPOSSIBLE, cost)
            for state, costs in enumerate(cost):
                rows, columns = linear_sum_assignment(costs)
                chosen[state, at[columns]] = own[rows]
    distance, turn = misses(chosen)
    met = (distance < task.episode.tolerance) & (world.held[..., None] != chosen)
    if not task.all_cubes:
        upright = is_upright(world, task)
        met = met & (upright[..., chosen] if chosen.ndim == 1 else np.take_along_axis(upright, chosen, axis=-1))
    return Misses(distance, turn, met & (turn < np.float32(math.radians(task.episode.turn_tolerance))))


def subgoals_missed(world: World) -> Int32[Array, " S"]:
    """Return the number of the task's subgoals that were not reached."""
    xp = namespace(world.reached)
    return xp.sum(~world.reached, axis=-1, dtype=np.int32)


def fitness(
    task: Task,
    *,
    distance: Float32[Array, "*E"],
    turn: Float32[Array, "*E"] | float = 0.0,
    subgoals_missed: Int32[Array, "*E"],
    nodes: Int32[Array, "*E"],
    ending: Int8[Array, "*E"],
) -> Float32[Array, "*E"]:
    """Return the fitness of episodes: `distance` [m] and `turn` [rad] are sums over the targets."""
    xp = namespace(distance)
    w = task.weights
    cost = np.float32(w.distance) * distance + np.float32(w.turn) * turn
    cost = cost + np.float32(w.node) * nodes.astype(np.float32)
    cost = cost + np.float32(w.subgoal) * subgoals_missed.astype(np.float32)
    cost = cost + np.float32(w.timeout) * (ending == Ending.TIMEOUT).astype(np.float32)
    cost = cost + np.float32(w.failure) * (ending == Ending.FAILURE).astype(np.float32)
    return xp.where(ending == Ending.BROKEN, np.float32(WORST_FITNESS), -cost)
