"""What every behavior returns in a state, for whole batches of states.

In a memoryless tree a leaf's status depends on the state alone, and so does that of a gene, with the one action that it
runs. So the outcome of every leaf is computed once for a state; a tick then only looks outcomes up. An action that has
used up its ticks fails, which a second layer of outcomes answers: the status once the running action counts as failed.

A subgoal counts as reached by the rule of the task, `subgoal_reward`. With `seen`, every state in which it holds reaches it.
With `ticked`, a tree does that ticks `reached(subgoal)` in such a state; the outcome of a leaf says which ones. Either way
`reached(subgoal)` succeeds from then on. A tick is the same before and after its own subgoals count as reached, since
`reached(subgoal)` succeeds wherever the subgoal holds.

Unknown is never true: while an object is out of sight, conditions that name it fail, as an object or as a frame, and no
action starts on it. What the gripper holds is known.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Int, Int32

from bt_jax.behaviors import FIRST_LEAF, Behavior, ExtendedNode, Kind, Tree
from bt_jax.encoding.interpret import DECORATED
from bt_jax.encoding.tick import Status
from bt_jax.mjx_env.conditions import ALL, Rows, SceneConditions, holding_subgoals
from bt_jax.mjx_env.driving import within_reach
from bt_jax.mjx_env.outcomes import ACTION, COMMAND_BITS, SUBGOAL_BITS
from bt_jax.mjx_env.predicates import graspable, in_own_target, is_clear, is_seen, reachable
from bt_jax.mjx_env.selection import Selection, atoms_of, selection_of, skeleton
from bt_jax.mjx_env.world import Array, World, frames, namespace, to_world

__all__ = ["LeafSemantics", "taken_by"]


@dataclasses.dataclass(frozen=True)
class LeafSemantics(SceneConditions):
    """What the leaves of a vocabulary mean in a task. Which instance of a part a `pick` takes, says `taken_by`."""

    @functools.cached_property
    def _named(self) -> dict[str, Int[np.ndarray, " n"]]:
        """Columns of all conditions of the same name, but for those of places and spots."""
        first = len(self.places) + len(self.spots)
        each = np.array([condition.name for condition in self.conditions[first:]])
        return {name: first + np.flatnonzero(each == name) for name in dict.fromkeys(each.tolist())}

    @functools.cached_property
    def _running(self) -> Int32[np.ndarray, " commands"]:
        """The outcome of each command that runs."""
        return np.arange(len(self.commands), dtype=np.int32) << COMMAND_BITS | np.int32(Status.RUNNING)

    @functools.cached_property
    def _groups(self) -> list[tuple[np.ndarray, Tree, np.ndarray]]:
        """Leaves with the same skeleton, evaluated together: (tokens [m], skeleton, columns of its atoms [atoms, m])."""
        groups: dict[str, tuple[list[int], Tree, list[list[int]]]] = {}
        for i, leaf in enumerate(self.vocabulary.leaves):
            body = leaf.subtree or leaf
            tokens, _, columns = groups.setdefault(skeleton(body), ([], body, []))
            tokens.append(FIRST_LEAF + i)
            columns.append([self.columns[atom] for atom in atoms_of(leaf)])
        return [(np.array(tokens), body, np.array(columns).T) for tokens, body, columns in groups.values()]

    @functools.cached_property
    def everything(self) -> Selection:
        """All tokens."""
        return selection_of(ALL, ALL, self._groups)

    def select(self, tokens: Int[np.ndarray, " m"]) -> Selection:
        """Return what computes the outcomes of some tokens without those of the others."""
        chosen = [(own, body, columns, np.isin(own, tokens)) for own, body, columns in self._groups]
        groups = [(own[here], body, columns[:, here]) for own, body, columns, here in chosen if here.any()]
        used = np.unique(np.concatenate([np.zeros(0, int), *(columns.ravel() for _, _, columns in groups)]))
        conditions, num_places, num_spots = len(self.conditions), len(self.places), len(self.spots)
        first = conditions + len(self.commands) - num_places  # the column of the first place's command
        drives = first - num_spots  # and of the first spot's
        places = np.union1d(used[used < num_places], used[used >= first] - first)
        spots = [used[(start <= used) & (used < start + num_spots)] - start for start in (num_places, drives)]
        near = np.union1d(*spots)
        between = np.arange(num_places + num_spots, drives)
        kept = np.concatenate([places, num_places + near, between, drives + near, first + places])
        return selection_of(
            places, near, [(own, body, np.searchsorted(kept, columns)) for own, body, columns in groups]
        )

    def outcomes(self, world: World, selection: Selection | None = None) -> Int32[Array, "2 S m"]:
        """Return the outcome of every token, or of the selected ones, in every state (see `outcomes`). The second layer
        holds the outcomes once the command that is running in the first counts as failed."""
        xp = namespace(world.poses)
        chosen = self.everything if selection is None else selection
        atoms = self._atom_outcomes(world, chosen.places, chosen.spots)
        layers = []
        failed: list[Array | None] = [None] * len(chosen.groups)
        for _ in range(2):
            columns = [xp.zeros((atoms.shape[0], FIRST_LEAF), np.int32)]
            for g, (body, atom_columns) in enumerate(chosen.groups):
                outcome = self._evaluate(body, atoms, list(atom_columns), failed[g])
                failed[g] = xp.where(outcome & 3 == Status.RUNNING, outcome & ACTION, np.int32(-1))
                columns.append(outcome)
            layers.append(xp.concatenate(columns, axis=1)[:, chosen.order])
        return xp.stack(layers)

    def _evaluate(
        self, node: Tree, atoms: Int32[Array, "S A"], columns: list[np.ndarray], failed: Array | None
    ) -> Int32[Array, "S m"]:
        """Return the outcome of a skeleton for m leaves at once, where the outcome `failed` counts as a failure;
        consumes `columns`."""
        xp = namespace(atoms)
        if isinstance(node, Behavior):
            outcome = atoms[:, columns.pop(0)]
            if failed is None or node.kind == Kind.CONDITION:
                return outcome
            return xp.where(outcome == failed, np.int32(Status.FAILURE), outcome)
        if isinstance(node, ExtendedNode):
            outcome = self._evaluate(node.children[0], atoms, columns, failed)
            returned = {status: np.int32(value) for status, value in DECORATED[node.name].items()}
            ended = xp.where(outcome & 3 == Status.SUCCESS, returned[Status.SUCCESS], returned[Status.FAILURE])
            return xp.where(outcome & 3 == Status.RUNNING, outcome, outcome & ~np.int32(3) | ended)
        proceed = Status.SUCCESS if node.kind == Kind.SEQUENCE else Status.FAILURE
        outcome = self._evaluate(node.children[0], atoms, columns, failed)
        for child in node.children[1:]:
            after = self._evaluate(child, atoms, columns, failed) | outcome & ~ACTION
            outcome = xp.where(outcome & 3 == proceed, after, outcome)
        return outcome

    def _atom_outcomes(self, world: World, places: Rows = ALL, spots: Rows = ALL) -> Int32[Array, "S A"]:
        """Return the outcomes of all conditions, then of all commands, those at some of the places and spots only. An action
        succeeds if its postconditions hold, fails if its preconditions do not, and otherwise runs."""
        xp = namespace(world.poses)
        near, can_approach = self.near(world, spots)
        conditions, place_name = self._condition_values(world, places, near), self.place_name[places]
        first = len(place_name) + len(self.spot_frame[spots])
        left_out = len(self.places) + len(self.spots) - first
        named = {name: self._named[name] - left_out for name in ("holding", "clear", "reachable")}
        named["is_seen"] = self._named.get("is_seen", np.zeros(0, int)) - left_out
        holding, can_hold = (conditions[:, named[name]] for name in ("holding", "clear"))
        holding, empty = holding[:, :-1], holding[:, -1:]
        opened, closed = world.gripper_open[:, None], ~world.gripper_open[:, None]
        can_pick = opened & can_hold & conditions[:, named["reachable"]]
        if not self._picks_are_plain:
            count = len(self.task.objects)
            free = can_hold[:, :count] & conditions[:, named["reachable"][:count]] & graspable(world, self.task)
            can_pick = opened & self._any_left(world, free)
        at = conditions[:, : len(place_name)]
        seen = conditions[:, named["is_seen"]]
        always = xp.ones((conditions.shape[0], 2), bool)
        can_place = holding[:, place_name]
        if world.unseen is not None:
            can_place = can_place & self.frames_seen(world)[:, self.place_frame[places]]
        if self.task.robot.base is not None:
            goal = to_world(frames(world, self.task), self.place_frame[places], self.place_position[places])
            can_place = can_place & within_reach(world, self.task, goal)
        is_near = near[:, : can_approach.shape[1]]
        done = xp.concatenate([opened & empty, closed, holding, seen, is_near, at & empty], axis=1)
        if self.has_parts:  # an instance is not put where it is itself
            can_place = can_place & (world.held[:, None] != self.place_frame[places].astype(np.int8)[None])
        possible = xp.concatenate([always, can_pick, xp.ones_like(seen), can_approach, can_place], axis=1)
        placing = self.first_place
        driving = placing - len(self.spots)
        each = [self._running[:driving], self._running[driving:placing][spots], self._running[placing:][places]]
        running = np.concatenate(each)[None]
        actions = xp.where(done, np.int32(Status.SUCCESS), xp.where(possible, running, np.int32(Status.FAILURE)))
        statuses = conditions.astype(np.int32)
        if self.num_ticked:
            ticked = conditions.shape[1] - self.num_ticked
            bits = np.int32(1) << np.arange(SUBGOAL_BITS, SUBGOAL_BITS + self.num_ticked, dtype=np.int32)
            new = xp.where(conditions[:, ticked:] & ~world.reached, bits[None], np.int32(0))
            statuses = xp.concatenate([statuses[:, :ticked], statuses[:, ticked:] | new], axis=1)
        return xp.concatenate([statuses, actions], axis=1)

    def _condition_values(self, world: World, places: Rows, near: Bool[Array, "S near"]) -> Bool[Array, "S conditions"]:
        xp = namespace(world.poses)
        reached = world.reached | holding_subgoals(self.task, world) if self.num_ticked else world.reached
        return xp.concatenate([self.scene_values(world, places, near), reached], axis=1)

    def _any_left(self, world: World, free: Bool[Array, "S B"]) -> Bool[Array, "S names"]:
        """Return for each name whether it can be picked: an object if it is `free`, that is clear, within reach and
        graspable, a part if an instance is that does not stand in a target of its own already."""
        if not self.has_parts:
            return free
        left = self.any_of(free & ~in_own_target(world, self.task))
        return namespace(free).concatenate([free, left[:, len(self.task.objects) :]], axis=1)

    @functools.cached_property
    def _picks_are_plain(self) -> bool:
        """Whether whatever is clear and within reach can be picked: the gripper takes every object in every position, and
        no part leaves a choice."""
        return self.task.all_cubes and not self.task.finger_room and not self.has_parts


def taken_by(semantics: LeafSemantics, world: World, pick: Int32[Array, " S"]) -> Int32[Array, " S"]:
    """Return which object a `pick` takes in each state, given as an index of `LeafSemantics.names`: of a part, the nearest
    to the robot of the instances that can be taken and do not stand in a target of theirs already; of several, the one with
    the lowest x, then y."""
    xp, task, count = namespace(world.poses), semantics.task, len(semantics.task.objects)
    if not semantics.has_parts or (xp is np and (pick < count).all()):
        return pick
    robot = np.array([task.robot_position[:2]], np.float32) if world.base is None else world.base
    away = (world.poses[..., 0] - robot[:, :1]) ** 2 + (world.poses[..., 1] - robot[:, 1:]) ** 2
    free = is_clear(world, task) & reachable(world, task) & graspable(world, task)
    if world.unseen is not None:
        free = free & is_seen(world)
    left = xp.asarray(semantics.members)[pick] & free & ~in_own_target(world, task)
    for key in (away, world.poses[..., 0], world.poses[..., 1]):
        key = xp.where(left, key, np.float32(np.inf))
        left = left & (key == key.min(axis=1, keepdims=True))
    nearest = xp.argmax(left, axis=1)
    return xp.where(pick < count, pick, nearest).astype(np.int32)
