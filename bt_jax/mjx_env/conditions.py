"""Which conditions hold in a scene, for whole batches of states.

Unknown is never true: while an object is out of sight, conditions that name it fail, as an object or as a frame. What the
gripper holds is known.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int32

from bt_jax.behaviors import Vocabulary, subgoal_conditions
from bt_jax.mjx_env.driving import stations_near, within_reach
from bt_jax.mjx_env.numbering import Numbering
from bt_jax.mjx_env.predicates import is_clear, is_seen, is_upright, loose, off_floor, reachable, turn_error
from bt_jax.mjx_env.world import Array, World, distances, frames, namespace, to_world
from bt_jax.tasks import Task

__all__ = ["ALL", "Rows", "SceneConditions", "holding_subgoals", "subgoals_by_sight"]

Rows: TypeAlias = np.ndarray | slice
ALL = slice(None)


@dataclasses.dataclass(frozen=True)
class SceneConditions(Numbering):
    """Which of the conditions hold that the leaves of a vocabulary name, all but `reached`. The name of a part means any of
    its instances."""

    def scene_values(self, world: World, places: Rows, near: Bool[Array, "S near"]) -> Bool[Array, "S conditions"]:
        """Return the values of all conditions but `reached`, those at some of the places, and for some names and spots that
        are `near`."""
        xp, names = namespace(world.poses), len(self.names)
        objects = np.arange(len(self.task.objects), dtype=np.int8)
        held = world.held[:, None] == objects[None]
        gripper = xp.stack([world.gripper_open, ~world.gripper_open], axis=1)
        clear = is_clear(world, self.task)
        if world.unseen is not None:
            clear = clear & is_seen(world)
        return xp.concatenate(
            [
                self._at(world, places),
                near[:, names:],
                self.any_of(held),
                (world.held < 0)[:, None],
                gripper,
                near[:, :names],
                self.any_of(clear),
                *([self.any_of(is_seen(world))[:, self._watched]] if self.watched else []),
            ],
            axis=1,
        )

    def _at(self, world: World, places: Rows) -> Bool[Array, "S places"]:
        """Return whether what each of the places is for stands there, any instance of a part, and turned as it says."""
        xp = namespace(world.poses)
        name, frame = self.place_name[places], self.place_frame[places]
        poses_of_frames = frames(world, self.task)
        goal = to_world(poses_of_frames, frame, self.place_position[places])
        wanted, own = self.place_turn[places], name
        if self.has_parts:  # all pairs of a place and an instance, those of a place side by side
            counts = self._counts[name]
            place, instance = np.nonzero(np.arange(self._instances.shape[1]) < counts[:, None])
            goal, frame, wanted, own = (
                goal[:, place],
                frame[place],
                wanted[place],
                self._instances[name[place], instance],
            )
        there = distances(world.poses[:, own, :3], goal) < np.float32(self.task.episode.tolerance)
        there = there & (world.held[:, None] != own.astype(np.int8)[None])
        if world.unseen is not None:
            there = there & is_seen(world)[:, own] & self.frames_seen(world)[:, frame]
        if not self.task.all_cubes:
            there = there & is_upright(world, self.task)[:, own]
        if self.turns:
            turns, of_frames = world.poses[:, own, 3:], poses_of_frames[:, frame, 3:]
            error = turn_error(turns, of_frames, wanted[None], self.symmetry[own][None])
            most = np.float32(math.radians(self.task.episode.turn_tolerance))
            there = there & (np.isnan(wanted)[None] | (xp.abs(error) < most))
        if not self.has_parts:
            return there
        there = there & (own != frame)[None]
        found = there[:, first := np.cumsum(counts) - counts]
        for k in range(1, self._instances.shape[1]):
            found = found | there[:, first + np.minimum(k, counts - 1)]
        return found

    def near(self, world: World, spots: Rows) -> tuple[Bool[Array, "S near"], Bool[Array, "S drives"]]:
        """Return which names, then which spots, are within reach, and which a robot that drives can reach from a station. Of
        a part, that counts for instances that may be taken; without a base, for all of them, and there are no drives."""
        xp, task, count = namespace(world.poses), self.task, len(self.task.objects)
        if task.robot.base is None:
            within = reachable(world, task)
            within = self.any_of(within if world.unseen is None else within & is_seen(world))
            return within, within[:, :0]
        meant, seen = off_floor(world, task) & is_seen(world), self.frames_seen(world)[:, self.spot_frame[spots]]
        taken = meant & loose(world, task) if self.has_parts else meant
        points = [world.poses[..., :3], self.spot_points(world, spots)]

        def joined(things: Bool[Array, "S B"], of_spots: Bool[Array, "S m"]) -> Bool[Array, "S near"]:
            return xp.concatenate([things & meant, self.any_of(things & taken)[:, count:], of_spots & seen], axis=1)

        within, from_stations = (
            joined(*(within_reach(world, task, each) for each in points)),
            joined(*(stations_near(task, each).any(axis=-1) for each in points)),
        )
        return within, from_stations

    def any_of(self, values: Bool[Array, "S B"]) -> Bool[Array, "S names"]:
        """Return for each name whether the value is true of any object that it stands for."""
        parts = self.members[len(self.task.objects) :]
        if not len(parts):
            return values
        return namespace(values).concatenate([values, *(values[:, own].any(axis=1, keepdims=True) for own in parts)], 1)

    def frames_seen(self, world: World) -> Bool[Array, "S F"]:
        """Return of which frames it is known where they are."""
        xp, others = namespace(world.poses), len(self.task.frames) - len(self.task.objects)
        return xp.concatenate([is_seen(world), xp.ones((world.held.shape[0], others), bool)], axis=1)

    def stations_of_name(self, world: World, name: Int32[Array, " S"]) -> Bool[Array, "S stations"]:
        """Return from which stations the arm reaches what each state's name stands for, given as an index of `names`."""
        xp, task = namespace(world.poses), self.task
        meant = xp.asarray(self.members)[name] & off_floor(world, task) & is_seen(world)
        if self.has_parts:
            meant = meant & ((name < len(task.objects))[:, None] | loose(world, task))
        return (stations_near(task, world.poses[..., :3]) & meant[..., None]).any(axis=1)

    def spot_points(self, world: World, spots: Rows = ALL) -> Float32[Array, "S m 3"]:
        """Return where spots are in the world."""
        return to_world(frames(world, self.task), self.spot_frame[spots], self.spot_position[spots])

    @functools.cached_property
    def _watched(self) -> np.ndarray:
        """Index in `names` of each of those watched, int[n]."""
        return np.array([self.names.index(name) for name in self.watched], int)

    @functools.cached_property
    def _instances(self) -> np.ndarray:
        """The objects that each name stands for, the last one repeated, int[names, most]."""
        of_names = [np.flatnonzero(own) for own in self.members]
        most = max(map(len, of_names))
        return np.array([np.pad(own, (0, most - len(own)), mode="edge") for own in of_names])

    @functools.cached_property
    def _counts(self) -> np.ndarray:
        """How many objects each name stands for, int[names]."""
        return self.members.sum(axis=1)


def subgoals_by_sight(task: Task, world: World) -> Bool[Array, "S G"]:
    """Return which of the task's subgoals count as reached in each state without a tick: by the task's rule all that hold,
    or none."""
    if task.subgoal_reward == "seen":
        return holding_subgoals(task, world)
    return namespace(world.poses).zeros((world.held.shape[0], len(task.subgoals)), bool)


def holding_subgoals(task: Task, world: World) -> Bool[Array, "S G"]:
    """Return which of the task's subgoals hold in each state."""
    xp = namespace(world.poses)
    if not task.subgoals:
        return xp.zeros((world.held.shape[0], 0), bool)
    scene, columns = _subgoal_columns(task)
    holds = scene.scene_values(world, ALL, scene.near(world, ALL)[0])
    return xp.stack([xp.all(holds[:, column], axis=1) for column in columns], axis=1)


@functools.lru_cache(maxsize=16)
def _subgoal_columns(task: Task) -> tuple[SceneConditions, list[np.ndarray]]:
    """Return what computes the conditions of the task's subgoals, and for each subgoal the columns of its own."""
    meanings = subgoal_conditions(task).values()
    scene = SceneConditions(task, Vocabulary.of(condition for meaning in meanings for condition in meaning))
    return scene, [np.array([scene.columns[condition] for condition in meaning]) for meaning in meanings]
