"""The symbols that trees are made of: control nodes, conditions, actions, genes, and the pool that evolution draws from.

A behavior is a name with arguments, written as `pick(YellowBox)` or `at(GreenBox, (0, 0, 0.1), YellowBox)`. Positions are
metres in the named frame and mean the centre of the object.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import re
from collections.abc import Iterable

import numpy as np

from bt_jax.errors import UserError
from bt_jax.tasks import Task

__all__ = [
    "FIRST_LEAF",
    "Behavior",
    "Control",
    "Kind",
    "Tree",
    "Vocabulary",
    "expand",
    "gene_pool",
    "parse_behavior",
    "subgoal_conditions",
]


class Kind(enum.IntEnum):
    """What a token is. The order is that of the tokens in a vocabulary."""

    PAD = 0
    SEQUENCE = 1
    FALLBACK = 2
    CONDITION = 3
    ACTION = 4
    GENE = 5


@dataclasses.dataclass(frozen=True)
class Signature:
    kind: Kind
    arguments: tuple[str, ...]
    cost: float = 0.0


SIGNATURES: dict[str, Signature] = {
    "at": Signature(Kind.CONDITION, ("object", "position", "frame")),
    "holding": Signature(Kind.CONDITION, ("object",)),
    "gripper": Signature(Kind.CONDITION, ("opening",)),
    "reachable": Signature(Kind.CONDITION, ("object",)),
    "clear": Signature(Kind.CONDITION, ("object",)),
    "reached": Signature(Kind.CONDITION, ("subgoal",)),
    "open_gripper": Signature(Kind.ACTION, (), cost=2.0),
    "close_gripper": Signature(Kind.ACTION, (), cost=2.0),
    "pick": Signature(Kind.ACTION, ("object",), cost=20.0),
    "place": Signature(Kind.ACTION, ("object", "position", "frame"), cost=20.0),
    "move": Signature(Kind.GENE, ("object", "position", "frame"), cost=40.0),
    "subtask": Signature(Kind.GENE, ("name", "tree")),
}

NOTHING = "nothing"
OPEN, CLOSED = "open", "closed"


@dataclasses.dataclass(frozen=True)
class Behavior:
    """A leaf: a condition, an action, or a gene. Compare and hash by value.

    The gene `subtask(name, tree)` makes one leaf of any tree, for instance of a demonstrated one.
    """

    name: str
    args: tuple[Argument, ...] = ()

    def __post_init__(self) -> None:
        if self.name not in SIGNATURES:
            raise UserError(f"unknown behavior '{self.name}'; use one of {', '.join(SIGNATURES)}")
        wanted = SIGNATURES[self.name].arguments
        if len(self.args) != len(wanted):
            raise UserError(f"{self.name} takes ({', '.join(wanted)}), found {len(self.args)} arguments; mend the call")
        for argument, value in zip(wanted, self.args, strict=True):
            if not isinstance(value, ARGUMENT_TYPES.get(argument, str)):
                raise UserError(f"{self.name}: {argument} cannot be {value!r}; write it as in {EXAMPLES[argument]}")
        if self.name == "gripper" and self.args[0] not in (OPEN, CLOSED):
            raise UserError(f"gripper({self.args[0]}) is unknown; write gripper(open) or gripper(closed)")

    @property
    def kind(self) -> Kind:
        return SIGNATURES[self.name].kind

    @property
    def cost(self) -> float:
        """What running the action once costs, in arbitrary units; planners prefer cheap ones."""
        return SIGNATURES[self.name].cost

    def _argument(self, name: str) -> Argument | None:
        wanted = SIGNATURES[self.name].arguments
        return self.args[wanted.index(name)] if name in wanted else None

    @property
    def object(self) -> str | None:
        return self._argument("object")

    @property
    def position(self) -> tuple[float, float, float] | None:
        return self._argument("position")

    @property
    def frame(self) -> str | None:
        return self._argument("frame")

    def __str__(self) -> str:
        if not self.args:
            return self.name
        return f"{self.name}({', '.join(_argument_text(value) for value in self.args)})"

    @property
    def label(self) -> str:
        """What stands in drawings: the text, but only the name of a subtask."""
        return self.args[0] if self.name == "subtask" else str(self)

    @property
    def preconditions(self) -> tuple[Behavior, ...]:
        """Conditions that must hold for the action to start, in the order in which to establish them."""
        if self.name == "pick":
            return (Behavior("gripper", (OPEN,)), Behavior("reachable", self.args), Behavior("clear", self.args))
        if self.name == "place":
            return (Behavior("holding", (self.object,)),)
        return ()

    @property
    def postconditions(self) -> tuple[Behavior, ...]:
        """Conditions that hold once the action has succeeded."""
        nothing = Behavior("holding", (NOTHING,))
        match self.name:
            case "open_gripper":
                return (Behavior("gripper", (OPEN,)), nothing)
            case "close_gripper":
                return (Behavior("gripper", (CLOSED,)),)
            case "pick":
                return (Behavior("holding", (self.object,)),)
            case "place":
                return (Behavior("at", self.args), nothing)
            case _:
                return ()

    @property
    def subtree(self) -> Tree | None:
        """What a gene stands for, without genes in it (of `move`: paper, figure 1); None for other behaviors."""
        if self.kind != Kind.GENE:
            return None
        if self.name == "subtask":
            return expand(self.args[1])
        pick = Behavior("pick", (self.object,))
        opened = Control.fallback(Behavior("gripper", (OPEN,)), Behavior("open_gripper"))
        held = Control.fallback(Behavior("holding", (self.object,)), Control.sequence(opened, pick))
        return Control.fallback(Behavior("at", self.args), Control.sequence(held, Behavior("place", self.args)))


@dataclasses.dataclass(frozen=True)
class Control:
    """A control node with its children; memoryless: ticked from the first child every time."""

    kind: Kind
    children: tuple[Tree, ...]

    @staticmethod
    def sequence(*children: Tree) -> Control:
        return Control(Kind.SEQUENCE, children)

    @staticmethod
    def fallback(*children: Tree) -> Control:
        return Control(Kind.FALLBACK, children)

    def __str__(self) -> str:
        return f"{self.kind.name.title()}({', '.join(map(str, self.children))})"


Tree = Behavior | Control
Argument = str | tuple[float, float, float] | Tree
ARGUMENT_TYPES = {"position": tuple, "tree": Tree}  # of those that are no names
EXAMPLES = {
    **dict.fromkeys(("object", "position", "frame"), "at(Box, (0, 0, 0.1), Frame)"),
    **dict.fromkeys(("name", "tree"), "subtask(unstack, Sequence(...))"),
    "opening": "gripper(open)",
    "subgoal": "reached(unstacked)",
}


def expand(tree: Tree) -> Tree:
    """The same tree with each gene replaced by the subtree that it stands for."""
    if isinstance(tree, Behavior):
        return tree.subtree or tree
    return Control(tree.kind, tuple(map(expand, tree.children)))


FIRST_LEAF = 3  # tokens 0, 1, 2 are padding, Sequence and Fallback


@dataclasses.dataclass(frozen=True)
class Vocabulary:
    """Leaves with their tokens. Token `FIRST_LEAF + i` is `leaves[i]`; conditions come first, then actions, then genes,
    so that each kind is one range of tokens."""

    leaves: tuple[Behavior, ...]

    def __post_init__(self) -> None:
        kinds = [leaf.kind for leaf in self.leaves]
        if kinds != sorted(kinds) or len(set(self.leaves)) < len(self.leaves):
            raise ValueError("leaves must be distinct and sorted by kind; use Vocabulary.of")
        subtasks = [leaf.args[0] for leaf in self.leaves if leaf.name == "subtask"]
        for name in subtasks:
            if subtasks.count(name) > 1:
                raise UserError(f"two different subtasks are called '{name}'; rename one of them")

    @staticmethod
    def of(leaves: Iterable[Behavior]) -> Vocabulary:
        """Distinct leaves, sorted by kind, otherwise in the order given."""
        return Vocabulary(tuple(sorted(dict.fromkeys(leaves), key=lambda leaf: leaf.kind)))

    def extended(self, leaves: Iterable[Behavior]) -> Vocabulary:
        """This vocabulary with more leaves; tokens may change."""
        return Vocabulary.of((*self.leaves, *leaves))

    def __len__(self) -> int:
        return FIRST_LEAF + len(self.leaves)

    @functools.cached_property
    def kinds(self) -> np.ndarray:
        """Kind of each token, int8[vocabulary]."""
        return np.array([Kind.PAD, Kind.SEQUENCE, Kind.FALLBACK, *(leaf.kind for leaf in self.leaves)], np.int8)

    @functools.cached_property
    def _tokens(self) -> dict[Behavior, int]:
        return {leaf: FIRST_LEAF + i for i, leaf in enumerate(self.leaves)}

    def token(self, leaf: Behavior) -> int:
        """Token of a leaf. Raises UserError where it is not in the vocabulary."""
        try:
            return self._tokens[leaf]
        except KeyError:
            raise UserError(
                f"the leaf {leaf} is not among the behaviors of this task; add it to the pool first"
            ) from None

    def leaf(self, token: int) -> Behavior:
        return self.leaves[token - FIRST_LEAF]


def gene_pool(task: Task) -> Vocabulary:
    """What evolution may use: gripper conditions and actions, a `reached` condition for each subgoal of the task, and one
    `move` gene for each box and each place that the task's gene settings define (57 in the published scene)."""
    conditions = [Behavior("gripper", (OPEN,)), Behavior("gripper", (CLOSED,)), Behavior("holding", (NOTHING,))]
    conditions += [Behavior("reached", (subgoal.name,)) for subgoal in task.subgoals]
    actions = [Behavior("open_gripper"), Behavior("close_gripper")]
    genes = [
        Behavior("move", (box.name, position, frame))
        for box in task.boxes
        for frame, position in _places(task, box.name, box.size)
    ]
    return Vocabulary.of([*conditions, *actions, *genes])


def _places(task: Task, name: str, size: float) -> list[tuple[str, tuple[float, float, float]]]:
    settings = task.genes
    places = []
    for other in task.boxes:
        if other.name == name:
            continue
        middle = (size + other.size) / 2
        beside = middle + settings.gap
        level = (size - other.size) / 2
        for x, y, z in (
            (-beside, 0.0, level),
            (beside, 0.0, level),
            (0.0, -beside, level),
            (0.0, beside, level),
            (0.0, 0.0, middle),
        ):
            places.append((other.name, _rounded(x, y, z)))
    steps = [settings.pitch * (i - (settings.grid - 1) / 2) for i in range(settings.grid)]
    places += [(task.kit.name, _rounded(x, y, settings.height)) for x in steps for y in steps]
    return places


def _rounded(*values: float) -> tuple[float, float, float]:
    return tuple(round(value, 6) + 0.0 for value in values)


def _argument_text(value: Argument) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(np.format_float_positional(x, trim='-') for x in value)})"
    return str(value)


_CALL = re.compile(r"\s*([A-Za-z_]\w*)\s*(?:\((.*)\))?\s*$", re.DOTALL)


def parse_behavior(text: str) -> Behavior:
    """Reads what `str(behavior)` writes, but for a subtask, which `encoding.text.parse_tree` reads. Raises UserError where
    it is not a behavior."""
    match = _CALL.match(text)
    if not match:
        raise UserError(f"'{text.strip()}' is not a behavior; write name(arguments), for instance pick(YellowBox)")
    name, inside = match.groups()
    args = []
    for part in re.findall(r"\([^()]*\)|[^,()]+", inside or ""):
        if part.startswith("("):
            args.append(_parse_position(part, text))
        elif part.strip():
            args.append(part.strip())
    return Behavior(name, tuple(args))


def _parse_position(part: str, text: str) -> tuple[float, float, float]:
    try:
        values = tuple(float(x) + 0.0 for x in part.strip("()").split(","))
    except ValueError:
        values = ()
    if len(values) != 3 or not np.all(np.isfinite(values)):
        raise UserError(f"in '{text.strip()}', {part} is not a position; write three numbers in metres, as (0, 0, 0.1)")
    return values


def subgoal_conditions(task: Task) -> dict[str, tuple[Behavior, ...]]:
    """What each subgoal of a task means, by its name. Raises UserError where it is not made of conditions of the scene."""
    meanings = {}
    for subgoal in task.subgoals:
        texts = (text.replace("{box}", name) for text in subgoal.conditions for name in task.box_names)
        meanings[subgoal.name] = tuple(map(parse_behavior, dict.fromkeys(texts)))
        for condition in meanings[subgoal.name]:
            if condition.kind != Kind.CONDITION or condition.name == "reached":
                raise UserError(
                    f"{condition} in the subgoal {subgoal.name} is not a condition of the scene; use at, holding, gripper, "
                    "reachable or clear"
                )
            check_names(condition, task)
    return meanings


def check_names(leaf: Behavior, task: Task) -> None:
    """Raises UserError where a leaf names an object, frame or subgoal that the task does not have."""
    if leaf.name == "subtask":
        _check_tree(leaf.args[1], task)
    objects = (*task.box_names, NOTHING) if leaf.name == "holding" else task.box_names
    if leaf.object is not None and leaf.object not in objects:
        raise UserError(f"{leaf}: task {task.name} has no object '{leaf.object}'; use one of {', '.join(objects)}")
    if leaf.frame is not None and (leaf.frame not in task.frames or leaf.frame == leaf.object):
        frames = [frame for frame in task.frames if frame != leaf.object]
        raise UserError(f"{leaf}: task {task.name} has no such frame '{leaf.frame}'; use one of {', '.join(frames)}")
    if leaf.name == "reached" and leaf.args[0] not in [subgoal.name for subgoal in task.subgoals]:
        raise UserError(f"{leaf}: task {task.name} declares no such subgoal; add it under subgoals")


def _check_tree(tree: Tree, task: Task) -> None:
    if isinstance(tree, Behavior):
        check_names(tree, task)
        return
    for child in tree.children:
        _check_tree(child, task)
