"""What every behavior returns in a state, for whole batches of states.

In a memoryless tree a leaf's status depends on the state alone, and so does that of a gene, with the one action that it
runs. So the outcome of every leaf is computed once for a state; a tick then only looks outcomes up. An action that has
used up its ticks fails, which a second layer of outcomes answers: the status once the running action counts as failed.

A subgoal counts as reached by the rule of the task, `subgoal_reward`. With `seen`, every state in which it holds reaches it.
With `ticked`, a tree does that ticks `reached(subgoal)` in such a state; the outcome of a leaf says which ones. Either way
`reached(subgoal)` succeeds from then on. A tick is the same before and after its own subgoals count as reached, since
`reached(subgoal)` succeeds wherever the subgoal holds.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Int, Int32

from bt_jax._util.errors import UserError
from bt_jax.behaviors import (
    FIRST_LEAF,
    NOTHING,
    OPEN,
    Behavior,
    Control,
    ExtendedNode,
    Kind,
    Tree,
    Vocabulary,
    check_names,
    subgoal_conditions,
)
from bt_jax.behaviors.geometry import GEOMETRY
from bt_jax.encoding.interpret import DECORATED
from bt_jax.encoding.tick import Status
from bt_jax.mjx_env.world import Array, World, distances, frames, namespace, to_world
from bt_jax.tasks import Task

__all__ = [
    "COMMAND_BITS",
    "SUBGOAL_BITS",
    "LeafSemantics",
    "Selection",
    "command_of",
    "holding_subgoals",
    "reachable",
    "subgoals_by_sight",
    "subgoals_of",
]

# An outcome is subgoals << SUBGOAL_BITS | command << COMMAND_BITS | status, with one bit for each subgoal that it reaches.
COMMAND_BITS, SUBGOAL_BITS = 2, 16
ALL = slice(None)
MAX_COMMANDS, MAX_SUBGOALS = 1 << (SUBGOAL_BITS - COMMAND_BITS), 31 - SUBGOAL_BITS


def command_of(outcome: Int32[Array, "*S"]) -> Int32[Array, "*S"]:
    """Return the number of the command that runs; 0 where none does."""
    return outcome >> COMMAND_BITS & np.int32(MAX_COMMANDS - 1)


def subgoals_of(outcome: Int32[Array, "*S"]) -> Int32[Array, "*S"]:
    """Return the subgoals that count as reached from now on, as bits."""
    return outcome >> SUBGOAL_BITS


@dataclasses.dataclass(frozen=True)
class Selection:
    """Some tokens of a vocabulary, control nodes among them, and what computes their outcomes."""

    tokens: np.ndarray  # int[m], ascending
    places: np.ndarray | slice  # of `LeafSemantics.places`, those that the leaves name
    groups: list[tuple[Tree, np.ndarray]]  # leaves with the same skeleton: it, and columns of its atoms [atoms, leaves]
    order: np.ndarray  # where to find each token when the groups stand side by side behind the control nodes


@dataclasses.dataclass(frozen=True)
class LeafSemantics:
    """What the leaves of a vocabulary mean in a task.

    Commands, the actions that the world can be asked for, are numbered: open_gripper, close_gripper, `pick` of each box,
    then `place` at each of the places (object, position, frame) that the leaves name.
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
        atoms = [atom for leaf in self.vocabulary.leaves for atom in _atoms(leaf)]
        return tuple(dict.fromkeys(Behavior("at", atom.args) for atom in atoms if atom.position is not None))

    @functools.cached_property
    def place_object(self) -> np.ndarray:
        """Index of the box of each place, int[n]."""
        return np.array([self.task.box_names.index(place.object) for place in self.places], int)

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
        picks = [Behavior("pick", (name,)) for name in self.task.box_names]
        places = [Behavior("place", place.args) for place in self.places]
        return (Behavior("open_gripper"), Behavior("close_gripper"), *picks, *places)

    @functools.cached_property
    def conditions(self) -> tuple[Behavior, ...]:
        """Every condition whose status is computed; `_condition_values` has one column for each."""
        names = self.task.box_names
        return (
            *self.places,
            *(Behavior("holding", (name,)) for name in (*names, NOTHING)),
            Behavior("gripper", (OPEN,)),
            Behavior("gripper", ("closed",)),
            *(Behavior("reachable", (name,)) for name in names),
            *(Behavior("clear", (name,)) for name in names),
            *(Behavior("reached", (subgoal.name,)) for subgoal in self.task.subgoals),
        )

    @functools.cached_property
    def _columns(self) -> dict[Behavior, int]:
        """Column of each atom in `_atom_outcomes`: conditions first, then commands."""
        return {atom: i for i, atom in enumerate((*self.conditions, *self.commands))}

    @functools.cached_property
    def _named(self) -> dict[str, list[int]]:
        """Columns of all conditions of the same name."""
        names = dict.fromkeys(condition.name for condition in self.conditions)
        return {name: [i for i, condition in enumerate(self.conditions) if condition.name == name] for name in names}

    @functools.cached_property
    def _groups(self) -> list[tuple[np.ndarray, Tree, np.ndarray]]:
        """Leaves with the same skeleton, evaluated together: (tokens [m], skeleton, columns of its atoms [atoms, m])."""
        groups: dict[str, tuple[list[int], Tree, list[list[int]]]] = {}
        for i, leaf in enumerate(self.vocabulary.leaves):
            body = leaf.subtree or leaf
            tokens, _, columns = groups.setdefault(_skeleton(body), ([], body, []))
            tokens.append(FIRST_LEAF + i)
            columns.append([self._columns[atom] for atom in _atoms(leaf)])
        return [(np.array(tokens), body, np.array(columns).T) for tokens, body, columns in groups.values()]

    @functools.cached_property
    def everything(self) -> Selection:
        """All tokens."""
        return _selection(slice(None), self._groups)

    def select(self, tokens: Int[np.ndarray, " m"]) -> Selection:
        """Return what computes the outcomes of some tokens without those of the others."""
        chosen = [(own, body, columns, np.isin(own, tokens)) for own, body, columns in self._groups]
        groups = [(own[here], body, columns[:, here]) for own, body, columns, here in chosen if here.any()]
        used = np.unique(np.concatenate([np.zeros(0, int), *(columns.ravel() for _, _, columns in groups)]))
        num_places = len(self.places)
        first = len(self.conditions) + len(self.commands) - num_places  # the column of the first place's command
        places = np.union1d(used[used < num_places], used[used >= first] - first)
        kept = np.concatenate([places, np.arange(num_places, first), first + places])
        return _selection(places, [(own, body, np.searchsorted(kept, columns)) for own, body, columns in groups])

    def outcomes(self, world: World, selection: Selection | None = None) -> Int32[Array, "2 S m"]:
        """Return the outcome of every token, or of the selected ones, in every state (see `COMMAND_BITS`). The second layer
        holds the outcomes once the command that is running in the first counts as failed."""
        xp = namespace(world.poses)
        chosen = self.everything if selection is None else selection
        atoms = self._atom_outcomes(world, chosen.places)
        layers = []
        failed: list[Array | None] = [None] * len(chosen.groups)
        for _ in range(2):
            columns = [xp.zeros((atoms.shape[0], FIRST_LEAF), np.int32)]
            for g, (body, atom_columns) in enumerate(chosen.groups):
                outcome = self._evaluate(body, atoms, list(atom_columns), failed[g])
                failed[g] = xp.where(outcome & 3 == Status.RUNNING, outcome & _ACTION, np.int32(-1))
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
            after = self._evaluate(child, atoms, columns, failed) | outcome & ~_ACTION
            outcome = xp.where(outcome & 3 == proceed, after, outcome)
        return outcome

    def _atom_outcomes(self, world: World, places: np.ndarray | slice = ALL) -> Int32[Array, "S A"]:
        """Return the outcomes of all conditions, then of all commands, those at some of the places only. An action succeeds
        if its postconditions hold, fails if its preconditions do not, and otherwise runs."""
        xp = namespace(world.poses)
        conditions, place_object = self._condition_values(world, places), self.place_object[places]
        left_out = len(self.places) - len(place_object)
        named = {name: np.array(columns) - left_out for name, columns in self._named.items()}
        holding, can_hold = (conditions[:, named[name]] for name in ("holding", "clear"))
        holding, empty = holding[:, :-1], holding[:, -1:]
        opened, closed = world.gripper_open[:, None], ~world.gripper_open[:, None]
        can_pick = opened & can_hold & conditions[:, named["reachable"]]
        at = conditions[:, : len(place_object)]
        done = xp.concatenate([opened & empty, closed, holding, at & empty], axis=1)
        always = xp.ones((conditions.shape[0], 2), bool)
        possible = xp.concatenate([always, can_pick, holding[:, place_object]], axis=1)
        numbers = np.arange(len(self.commands), dtype=np.int32)
        others = len(self.commands) - len(self.places)
        numbers = np.concatenate([numbers[:others], numbers[others:][places]])
        running = (numbers << COMMAND_BITS)[None] | np.int32(Status.RUNNING)
        actions = xp.where(done, np.int32(Status.SUCCESS), xp.where(possible, running, np.int32(Status.FAILURE)))
        statuses = conditions.astype(np.int32)
        if self.num_ticked:
            first = conditions.shape[1] - self.num_ticked
            bits = np.int32(1) << np.arange(SUBGOAL_BITS, SUBGOAL_BITS + self.num_ticked, dtype=np.int32)
            new = xp.where(conditions[:, first:] & ~world.reached, bits[None], np.int32(0))
            statuses = xp.concatenate([statuses[:, :first], statuses[:, first:] | new], axis=1)
        return xp.concatenate([statuses, actions], axis=1)

    def _condition_values(self, world: World, places: np.ndarray | slice = ALL) -> Bool[Array, "S conditions"]:
        xp = namespace(world.poses)
        reached = world.reached | holding_subgoals(self.task, world) if self.num_ticked else world.reached
        return xp.concatenate([self._scene_values(world, places), reached], axis=1)

    def _scene_values(self, world: World, places: np.ndarray | slice = ALL) -> Bool[Array, "S conditions"]:
        """Return the values of all conditions but `reached`, those at some of the places only."""
        xp = namespace(world.poses)
        place_object = self.place_object[places]
        goal = to_world(frames(world, self.task), self.place_frame[places], self.place_position[places])
        away = distances(world.poses[:, place_object, :3], goal)
        boxes = np.arange(len(self.task.boxes), dtype=np.int8)
        holding = world.held[:, None] == np.append(boxes, np.int8(-1))[None]
        gripper = xp.stack([world.gripper_open, ~world.gripper_open], axis=1)
        carried = world.held[:, None] == place_object.astype(np.int8)[None]
        return xp.concatenate(
            [
                (away < np.float32(self.task.episode.tolerance)) & ~carried,
                holding,
                gripper,
                reachable(world, self.task),
                ~xp.any(_rests_on(world, self.task), axis=-2),
            ],
            axis=1,
        )


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
    holds = semantics._scene_values(world)
    return xp.stack([xp.all(holds[:, column], axis=1) for column in columns], axis=1)


@functools.lru_cache(maxsize=16)
def _subgoal_columns(task: Task) -> tuple[LeafSemantics, list[np.ndarray]]:
    """Return what computes the conditions of the task's subgoals, and for each subgoal the columns of its own."""
    meanings = subgoal_conditions(task).values()
    semantics = LeafSemantics(task, Vocabulary.of(condition for meaning in meanings for condition in meaning))
    return semantics, [np.array([semantics._columns[condition] for condition in meaning]) for meaning in meanings]


def reachable(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which boxes the gripper reaches: those not below the lowest table's top, so not on the floor."""
    sizes = np.array([[box.size for box in task.boxes]], np.float32)
    lowest = np.float32(min(table.top for table in task.tables))
    return world.poses[..., 2] > lowest - np.float32(GEOMETRY.seated) * sizes


def _rests_on(world: World, task: Task) -> Bool[Array, "S B B"]:
    """Return at [s, i, j] whether box i stands over box j, close enough to rest on it; a held box rests on nothing."""
    xp = namespace(world.poses)
    sizes = np.array([box.size for box in task.boxes], np.float32)
    middle = ((sizes[:, None] + sizes[None, :]) / 2)[None]
    offset = world.poses[..., :, None, :3] - world.poses[..., None, :, :3]
    least, most = np.float32(GEOMETRY.above_least), np.float32(GEOMETRY.above_most)
    above = (offset[..., 2] > least * middle) & (offset[..., 2] < most * middle)
    over = xp.max(xp.abs(offset[..., :2]), axis=-1) < middle
    held = world.held[..., None] == np.arange(len(sizes), dtype=np.int8)[None]
    return above & over & ~held[..., :, None] & ~held[..., None, :]


def _selection(places: np.ndarray | slice, groups: list[tuple[np.ndarray, Tree, np.ndarray]]) -> Selection:
    tokens = np.concatenate([np.arange(FIRST_LEAF), *(own for own, _, _ in groups)])
    order = np.argsort(tokens)
    return Selection(tokens[order], places, [(body, columns) for _, body, columns in groups], order)


_ACTION = np.int32((1 << SUBGOAL_BITS) - 1)  # an outcome without its subgoals


def _atoms(leaf: Tree) -> list[Behavior]:
    """Return the conditions and actions of a leaf, in prefix order; those of its subtree for a gene."""
    if isinstance(leaf, Control | ExtendedNode):
        return [atom for child in leaf.children for atom in _atoms(child)]
    return _atoms(leaf.subtree) if leaf.subtree else [leaf]


def _skeleton(node: Tree) -> str:
    if isinstance(node, Behavior):
        return _skeleton(node.subtree) if node.subtree else node.kind.name
    name = node.kind.name if isinstance(node, Control) else node.name
    return f"{name}({','.join(_skeleton(child) for child in node.children)})"
