"""What an episode was worth (paper, equation 1)."""

from __future__ import annotations

import dataclasses
import functools
import math

import jax
import numpy as np
from jaxtyping import Bool, Float32, Int, Int8, Int32

from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.predicates import is_upright, stands_in, turn_error
from bt_jax.mjx_env.world import Array, World, distances, frames, namespace, order_of_rows, to_world
from bt_jax.tasks import Task

__all__ = ["WORST_FITNESS", "Misses", "fitness", "subgoals_missed", "target_misses"]

WORST_FITNESS = -1e6  # of an individual whose simulation diverged
IMPOSSIBLE = np.float32(1e9)  # cost of an instance that a target does not mean, or that is its frame


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Misses:
    """How far the targets of a task are from being met in S states (NumPy)."""

    distance: Float32[np.ndarray, "*S targets"]  # metres, of the object from where it should be
    turn: Float32[np.ndarray, "*S targets"]  # radians, of the object from how it should lie; 0 where any turn will do
    met: Bool[np.ndarray, "*S targets"]  # an object that is meant stands there (see `stands_in`)


def target_misses(task: Task, world: World) -> Misses:
    """Return how far each target is from being met, with the instances of each part assigned to its targets so that they
    cost least (Kuhn 1955), whatever their order. An instance is never assigned to a place in its own frame, and one that a
    target names only to that target.

    The targets that are met are not read off this assignment, since it may leave one out: with instances in the second and
    the third slot of a row, it costs as much to move both up by one as to send the last one to the front.
    """
    goals = _goals(task)
    poses_of_frames = frames(world, task)
    goal = to_world(poses_of_frames, goals.frame, goals.position)

    def misses(own: Int[np.ndarray, "*S targets"]) -> tuple[np.ndarray, np.ndarray]:
        poses = world.poses[..., own, :] if own.ndim == 1 else np.take_along_axis(world.poses, own[..., None], axis=-2)
        turned = np.zeros(goal.shape[:-1], np.float32)
        if goals.turned:
            error = turn_error(poses[..., 3:], poses_of_frames[..., goals.frame, 3:], goals.turn, goals.symmetry[own])
            turned = np.where(np.isnan(goals.turn), np.float32(0), np.abs(error))
        return distances(poses[..., :3], goal), turned

    first = goals.first
    if goals.parts:
        # SciPy's optimizers take long to import, and tasks without parts do without them.
        from scipy.optimize import linear_sum_assignment

        chosen = np.tile(first, (len(goal), 1))
        weights = task.weights
        there, _ = stands_in(world, task, task.targets)
        met = there.any(axis=1)
        for at, instances in goals.parts:
            own = instances[order_of_rows(world.poses[:, instances])]  # [S, m]
            is_own = np.isin(np.arange(len(first)), at)
            each = [misses(np.where(is_own, own[:, [k]], first)) for k in range(own.shape[1])]
            cost = np.stack([weights.distance * away + weights.turn * turned for away, turned in each], axis=-2)[
                ..., at
            ]
            cost = np.where(goals.meant[own[..., None], at], cost, IMPOSSIBLE)
            for state, (costs, names) in enumerate(zip(cost, own, strict=True)):
                rows, columns = linear_sum_assignment(costs)
                chosen[state, at[columns]] = names[rows]
                stands = there[state][np.ix_(names, at)]
                rows, columns = linear_sum_assignment(stands, maximize=True)
                met[state, at[columns]] = stands[rows, columns]
        return Misses(*misses(chosen), met)
    distance, turn = misses(first)
    met = (distance < task.episode.tolerance) & (world.held[..., None] != first)
    if not task.all_cubes:
        met = met & is_upright(world, task)[..., first]
    return Misses(distance, turn, met & (turn < np.float32(math.radians(task.episode.turn_tolerance))))


@dataclasses.dataclass(frozen=True)
class _Goals:
    """The targets of a task, and B objects, as arrays (NumPy)."""

    frame: Int[np.ndarray, " targets"]
    position: Float32[np.ndarray, "targets 3"]
    turn: Float32[np.ndarray, " targets"]  # radians, NaN where any will do
    turned: bool  # whether any target says how its object should be turned
    first: Int[np.ndarray, " targets"]  # the first object that each target may mean
    meant: Bool[np.ndarray, "B targets"]  # which objects each target may mean, none of them its frame
    parts: tuple[
        tuple[Int[np.ndarray, " _"], Int[np.ndarray, " _"]], ...
    ]  # targets of a part or of instances of it, and these
    symmetry: Float32[np.ndarray, " B"]  # radians


@functools.lru_cache(maxsize=16)
def _goals(task: Task) -> _Goals:
    names, instances = task.object_names, task.instances
    turn = np.array([math.nan if t.turn is None else math.radians(t.turn) for t in task.targets], np.float32)
    meant = [target.object for target in task.targets]
    return _Goals(
        frame=np.array([task.frames.index(target.frame) for target in task.targets], int),
        position=np.array([target.position for target in task.targets], np.float32).reshape(-1, 3),
        turn=turn,
        turned=not np.isnan(turn).all(),
        first=np.array([names.index(instances[one][0]) for one in meant], int),
        meant=np.array(
            [[name in instances[t.object] and name != t.frame for t in task.targets] for name in names], bool
        ),
        parts=tuple(
            (
                np.flatnonzero([one == part or one in instances[part] for one in meant]),
                np.array([names.index(name) for name in instances[part]]),
            )
            for part in dict.fromkeys(meant)
            if len(instances[part]) > 1
        ),
        symmetry=np.array([math.radians(thing.symmetry) for thing in task.objects], np.float32),
    )


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
    travel: Float32[Array, "*E"] | None = None,
) -> Float32[Array, "*E"]:
    """Return the fitness of episodes: `distance` [m] and `turn` [rad] are sums over the targets; `travel` [m] is how far a
    base has driven."""
    xp = namespace(distance)
    w = task.weights
    cost = np.float32(w.distance) * distance + np.float32(w.turn) * turn
    cost = cost + np.float32(w.node) * nodes.astype(np.float32)
    cost = cost + np.float32(w.subgoal) * subgoals_missed.astype(np.float32)
    cost = cost + np.float32(w.timeout) * (ending == Ending.TIMEOUT).astype(np.float32)
    cost = cost + np.float32(w.failure) * (ending == Ending.FAILURE).astype(np.float32)
    if travel is not None:
        cost = cost + np.float32(w.travel) * travel
    return xp.where(ending == Ending.BROKEN, np.float32(WORST_FITNESS), -cost)
