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
import math
from typing import TypeAlias

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from bt_jax._util.errors import UserError
from bt_jax.behaviors import (
    FIRST_LEAF,
    NOTHING,
    OPEN,
    Argument,
    Behavior,
    ExtendedNode,
    Kind,
    Tree,
    Vocabulary,
    check_names,
    is_spot,
    subgoal_conditions,
)
from bt_jax.encoding.interpret import DECORATED
from bt_jax.encoding.tick import Status
from bt_jax.mjx_env.driving import stations_near, within_reach
from bt_jax.mjx_env.outcomes import ACTION, COMMAND_BITS, MAX_COMMANDS, MAX_SUBGOALS, SUBGOAL_BITS
from bt_jax.mjx_env.predicates import (
    graspable,
    in_own_target,
    is_clear,
    is_seen,
    is_upright,
    loose,
    off_floor,
    reachable,
    turn_error,
)
from bt_jax.mjx_env.selection import Selection, atoms_of, selection_of, skeleton
from bt_jax.mjx_env.world import Array, World, distances, frames, namespace, to_world
from bt_jax.tasks import Task

__all__ = ["LeafSemantics", "holding_subgoals", "subgoals_by_sight", "taken_by"]

Rows: TypeAlias = np.ndarray | slice
ALL = slice(None)


@dataclasses.dataclass(frozen=True)
class LeafSemantics:
    """What the leaves of a vocabulary mean in a task.

    Commands, the actions that the world can be asked for, are numbered: open_gripper, close_gripper, `pick` of each object
    and each part, `look` for each of those `watched`; where the robot drives, `approach` of each name, then of each of the
    spots (a kit, or a position in a frame) that the leaves name; and `place` at each of the places (object, position, frame,
    turn) that the leaves name. A name of a part means any of its instances; which one a `pick` takes, says `taken_by`.
    """

    task: Task
    vocabulary: Vocabulary

    def __post_init__(self) -> None:
        for leaf in self.vocabulary.leaves:
            check_names(leaf, self.task)
        if len(self.commands) >= MAX_COMMANDS:
            raise UserError(
                f"{len(self.commands)} different actions are too many; use fewer genes, below {MAX_COMMANDS}"
            )
        if self.num_ticked > MAX_SUBGOALS:
            raise UserError(f"{self.num_ticked} subgoals are too many; use at most {MAX_SUBGOALS}")

    @property
    def num_ticked(self) -> int:
        """The number of subgoals that count as reached only once the tree has ticked them."""
        return len(self.task.subgoals) if self.task.subgoal_reward == "ticked" else 0

    @functools.cached_property
    def places(self) -> tuple[Behavior, ...]:
        """All distinct `at(object, position, frame)` that the leaves name, also inside genes."""
        atoms = [atom for leaf in self.vocabulary.leaves for atom in atoms_of(leaf)]
        return tuple(dict.fromkeys(Behavior("at", atom.args) for atom in atoms if atom.name in ("at", "place")))

    @functools.cached_property
    def spots(self) -> tuple[Behavior, ...]:
        """All distinct `reachable(frame, position)` and `reachable(kit)` that the leaves name, also inside genes."""
        atoms = [atom for leaf in self.vocabulary.leaves for atom in atoms_of(leaf)]
        near = [atom for atom in atoms if atom.name in ("reachable", "approach") and is_spot(atom, self.task)]
        return tuple(dict.fromkeys(Behavior("reachable", atom.args) for atom in near))

    @functools.cached_property
    def spot_frame(self) -> np.ndarray:
        """Index of the frame of each spot in `task.frames`, int[m]."""
        return np.array([self.task.frames.index(str(spot.object)) for spot in self.spots], int)

    @functools.cached_property
    def spot_position(self) -> np.ndarray:
        """Position of each spot in its frame, float32[m, 3]."""
        return np.array([spot.position or (0, 0, 0) for spot in self.spots], np.float32).reshape(-1, 3)

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """What leaves may call an object: every object, then every part."""
        return tuple(self.task.instances)

    @property
    def num_picks(self) -> int:
        return len(self.names)

    @functools.cached_property
    def watched(self) -> tuple[str, ...]:
        """The names that leaves look for, or ask for whether they are seen."""
        atoms = [atom for leaf in self.vocabulary.leaves for atom in atoms_of(leaf)]
        asked = {atom.object for atom in atoms if atom.name in ("look", "is_seen")}
        return tuple(name for name in self.names if name in asked)

    @functools.cached_property
    def members(self) -> np.ndarray:
        """Which objects each of the names stands for, bool[names, B]."""
        names = self.task.object_names
        return np.array([[name in self.task.instances[one] for name in names] for one in self.names], bool)

    @functools.cached_property
    def place_name(self) -> np.ndarray:
        """Index in `names` of what each place is for, int[n]."""
        return np.array([self.names.index(str(place.object)) for place in self.places], int)

    @functools.cached_property
    def place_turn(self) -> np.ndarray:
        """How each place wants an object to be turned in its frame, radians, NaN where it does not say, float32[n]."""
        turns = [math.nan if place.turn is None else math.radians(place.turn) for place in self.places]
        return np.array(turns, np.float32)

    @functools.cached_property
    def turns(self) -> bool:
        """Whether any place says how an object should be turned."""
        return not bool(np.isnan(self.place_turn).all())

    @functools.cached_property
    def symmetry(self) -> np.ndarray:
        """The angle about the vertical after which each object looks alike, radians, 0 for any angle, float32[B]."""
        return np.array([math.radians(thing.symmetry) for thing in self.task.objects], np.float32)

    @functools.cached_property
    def place_frame(self) -> np.ndarray:
        """Index of the frame of each place in `task.frames`, int[n]."""
        return np.array([self.task.frames.index(place.frame) for place in self.places], int)

    @functools.cached_property
    def place_position(self) -> np.ndarray:
        """Position of each place in its frame, float32[n, 3]."""
        return np.array([place.position for place in self.places], np.float32).reshape(-1, 3)

    @functools.cached_property
    def commands(self) -> tuple[Behavior, ...]:
        """The action behind each command."""
        picks = [Behavior("pick", (name,)) for name in self.names]
        drives = [Behavior("approach", args) for args in self.approached]
        places = [Behavior("place", place.args) for place in self.places]
        looks = [Behavior("look", (name,)) for name in self.watched]
        return (Behavior("open_gripper"), Behavior("close_gripper"), *picks, *looks, *drives, *places)

    @property
    def first_place(self) -> int:
        """The number of the first command that is a `place`; those after it are, too."""
        return len(self.commands) - len(self.places)

    @functools.cached_property
    def approached(self) -> tuple[tuple[Argument, ...], ...]:
        """What each drive is to: names, then spots; nothing where the robot does not drive."""
        return (
            () if self.task.robot.base is None else (*((name,) for name in self.names), *(s.args for s in self.spots))
        )

    @functools.cached_property
    def conditions(self) -> tuple[Behavior, ...]:
        """Every condition whose status is computed; `_condition_values` has one column for each."""
        names = self.names
        return (
            *self.places,
            *self.spots,
            *(Behavior("holding", (name,)) for name in (*names, NOTHING)),
            Behavior("gripper", (OPEN,)),
            Behavior("gripper", ("closed",)),
            *(Behavior("reachable", (name,)) for name in names),
            *(Behavior("clear", (name,)) for name in names),
            *(Behavior("is_seen", (name,)) for name in self.watched),
            *(Behavior("reached", (subgoal.name,)) for subgoal in self.task.subgoals),
        )

    @functools.cached_property
    def _columns(self) -> dict[Behavior, int]:
        """Column of each atom in `_atom_outcomes`: conditions first, then commands."""
        return {atom: i for i, atom in enumerate((*self.conditions, *self.commands))}

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
            columns.append([self._columns[atom] for atom in atoms_of(leaf)])
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
        near, can_approach = self._near(world, spots)
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
            can_place = can_place & self._frames_seen(world)[:, self.place_frame[places]]
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
        return xp.concatenate([self._scene_values(world, places, near), reached], axis=1)

    def _scene_values(self, world: World, places: Rows, near: Bool[Array, "S near"]) -> Bool[Array, "S conditions"]:
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

    @functools.cached_property
    def _watched(self) -> np.ndarray:
        """Index in `names` of each of those watched, int[n]."""
        return np.array([self.names.index(name) for name in self.watched], int)

    def _frames_seen(self, world: World) -> Bool[Array, "S F"]:
        """Return of which frames it is known where they are."""
        xp, others = namespace(world.poses), len(self.task.frames) - len(self.task.objects)
        return xp.concatenate([is_seen(world), xp.ones((world.held.shape[0], others), bool)], axis=1)

    def _near(self, world: World, spots: Rows) -> tuple[Bool[Array, "S near"], Bool[Array, "S drives"]]:
        """Return which names, then which spots, are within reach, and which a robot that drives can reach from a station. Of
        a part, that counts for instances that may be taken; without a base, for all of them, and there are no drives."""
        xp, task, count = namespace(world.poses), self.task, len(self.task.objects)
        if task.robot.base is None:
            within = reachable(world, task)
            within = self.any_of(within if world.unseen is None else within & is_seen(world))
            return within, within[:, :0]
        meant, seen = off_floor(world, task) & is_seen(world), self._frames_seen(world)[:, self.spot_frame[spots]]
        taken = meant & loose(world, task) if self.has_parts else meant
        points = [world.poses[..., :3], self.spot_points(world, spots)]

        def joined(things: Bool[Array, "S B"], of_spots: Bool[Array, "S m"]) -> Bool[Array, "S near"]:
            return xp.concatenate([things & meant, self.any_of(things & taken)[:, count:], of_spots & seen], axis=1)

        within, from_stations = (
            joined(*(within_reach(world, task, each) for each in points)),
            joined(*(stations_near(task, each).any(axis=-1) for each in points)),
        )
        return within, from_stations

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

    def any_of(self, values: Bool[Array, "S B"]) -> Bool[Array, "S names"]:
        """Return for each name whether the value is true of any object that it stands for."""
        parts = self.members[len(self.task.objects) :]
        if not len(parts):
            return values
        return namespace(values).concatenate([values, *(values[:, own].any(axis=1, keepdims=True) for own in parts)], 1)

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
            there = there & is_seen(world)[:, own] & self._frames_seen(world)[:, frame]
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

    @functools.cached_property
    def has_parts(self) -> bool:
        """Whether leaves may name a part for any of its instances."""
        return len(self.names) > len(self.task.objects)

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
    semantics, columns = _subgoal_columns(task)
    holds = semantics._scene_values(world, ALL, semantics._near(world, ALL)[0])
    return xp.stack([xp.all(holds[:, column], axis=1) for column in columns], axis=1)


@functools.lru_cache(maxsize=16)
def _subgoal_columns(task: Task) -> tuple[LeafSemantics, list[np.ndarray]]:
    """Return what computes the conditions of the task's subgoals, and for each subgoal the columns of its own."""
    meanings = subgoal_conditions(task).values()
    semantics = LeafSemantics(task, Vocabulary.of(condition for meaning in meanings for condition in meaning))
    return semantics, [np.array([semantics._columns[condition] for condition in meaning]) for meaning in meanings]
