"""What the leaves of a vocabulary name in a task, as numbers: objects and parts, places, spots, conditions and commands."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import NOTHING, OPEN, Argument, Behavior, Vocabulary, check_names, is_spot
from bt_jax.mjx_env.outcomes import MAX_COMMANDS, MAX_SUBGOALS
from bt_jax.mjx_env.selection import atoms_of
from bt_jax.tasks import Task

__all__ = ["Numbering"]


@dataclasses.dataclass(frozen=True)
class Numbering:
    """What the leaves of a vocabulary name in a task, numbered.

    Commands, the actions that the world can be asked for, are open_gripper, close_gripper, `pick` of each object
    and each part, `look` for each of those `watched`; where the robot drives, `approach` of each name, then of each of the
    spots (a kit, or a position in a frame) that the leaves name; and `place` at each of the places (object, position, frame,
    turn) that the leaves name.
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
    def names(self) -> tuple[str, ...]:
        """What leaves may call an object: every object, then every part."""
        return tuple(self.task.instances)

    @property
    def num_picks(self) -> int:
        return len(self.names)

    @functools.cached_property
    def has_parts(self) -> bool:
        """Whether leaves may name a part for any of its instances."""
        return len(self.names) > len(self.task.objects)

    @functools.cached_property
    def members(self) -> np.ndarray:
        """Which objects each of the names stands for, bool[names, B]."""
        names = self.task.object_names
        return np.array([[name in self.task.instances[one] for name in names] for one in self.names], bool)

    @functools.cached_property
    def watched(self) -> tuple[str, ...]:
        """The names that leaves look for, or ask for whether they are seen."""
        atoms = [atom for leaf in self.vocabulary.leaves for atom in atoms_of(leaf)]
        asked = {atom.object for atom in atoms if atom.name in ("look", "is_seen")}
        return tuple(name for name in self.names if name in asked)

    @functools.cached_property
    def symmetry(self) -> np.ndarray:
        """The angle about the vertical after which each object looks alike, radians, 0 for any angle, float32[B]."""
        return np.array([math.radians(thing.symmetry) for thing in self.task.objects], np.float32)

    @functools.cached_property
    def places(self) -> tuple[Behavior, ...]:
        """All distinct `at(object, position, frame)` that the leaves name, also inside genes."""
        atoms = [atom for leaf in self.vocabulary.leaves for atom in atoms_of(leaf)]
        return tuple(dict.fromkeys(Behavior("at", atom.args) for atom in atoms if atom.name in ("at", "place")))

    @functools.cached_property
    def place_name(self) -> np.ndarray:
        """Index in `names` of what each place is for, int[n]."""
        return np.array([self.names.index(str(place.object)) for place in self.places], int)

    @functools.cached_property
    def place_frame(self) -> np.ndarray:
        """Index of the frame of each place in `task.frames`, int[n]."""
        return np.array([self.task.frames.index(place.frame) for place in self.places], int)

    @functools.cached_property
    def place_position(self) -> np.ndarray:
        """Position of each place in its frame, float32[n, 3]."""
        return np.array([place.position for place in self.places], np.float32).reshape(-1, 3)

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
        """Every condition whose status is computed; `LeafSemantics` has one column for each."""
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
    def columns(self) -> dict[Behavior, int]:
        """Column of each atom in what `LeafSemantics` computes: conditions first, then commands."""
        return {atom: i for i, atom in enumerate((*self.conditions, *self.commands))}
