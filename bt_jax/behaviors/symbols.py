"""The leaves of trees for pick-and-place: conditions, actions and genes.

A behavior is a name with arguments, written as `pick(YellowBox)` or `at(GreenBox, (0, 0, 0.1), YellowBox)`. Positions are
metres in the named frame and mean the centre of the object. Where a fourth argument follows, as in
`at(Plate, (0, 0, 0.02), Tray, 90)`, the object is turned by so many degrees about the vertical of that frame.

A robot that drives has `approach(YellowBox)` and, for a place in a frame, `approach(Tray, (0, 0, 0.02))`; both drive until
what they name is within reach, as `reachable` of the same arguments says.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, Node, not_memoryless

__all__ = [
    "CLOSED",
    "NOTHING",
    "OPEN",
    "SIGNATURES",
    "Argument",
    "Behavior",
    "Signature",
    "Tree",
    "expand",
]


@dataclasses.dataclass(frozen=True)
class Signature:
    kind: Kind
    arguments: tuple[str, ...]
    cost: float = 0.0
    optional: tuple[str, ...] = ()  # further arguments, behind the others


SIGNATURES: dict[str, Signature] = {
    "at": Signature(Kind.CONDITION, ("object", "position", "frame"), optional=("turn",)),
    "holding": Signature(Kind.CONDITION, ("object",)),
    "gripper": Signature(Kind.CONDITION, ("opening",)),
    "reachable": Signature(Kind.CONDITION, ("object",), optional=("position",)),
    "clear": Signature(Kind.CONDITION, ("object",)),
    "reached": Signature(Kind.CONDITION, ("subgoal",)),
    "is_seen": Signature(Kind.CONDITION, ("object",)),
    "open_gripper": Signature(Kind.ACTION, (), cost=2.0),
    "close_gripper": Signature(Kind.ACTION, (), cost=2.0),
    "approach": Signature(Kind.ACTION, ("object",), cost=30.0, optional=("position",)),
    "pick": Signature(Kind.ACTION, ("object",), cost=20.0),
    "place": Signature(Kind.ACTION, ("object", "position", "frame"), cost=20.0, optional=("turn",)),
    "look": Signature(Kind.ACTION, ("object",), cost=5.0),
    "move": Signature(Kind.GENE, ("object", "position", "frame"), cost=40.0, optional=("turn",)),
    "carry": Signature(Kind.GENE, ("object", "position", "frame"), cost=100.0, optional=("turn",)),
    "subtask": Signature(Kind.GENE, ("name", "tree")),
}

NOTHING = "nothing"
OPEN, CLOSED = "open", "closed"


@dataclasses.dataclass(frozen=True, repr=False)
class Behavior:
    """A leaf: a condition, an action, or a gene. Compare and hash by value.

    The gene `subtask(name, tree)` makes one leaf of any memoryless tree, for instance of a demonstrated one.
    """

    name: str
    args: tuple[Argument, ...] = ()

    def __post_init__(self) -> None:
        if self.name not in SIGNATURES:
            raise UserError(f"unknown behavior '{self.name}'; use one of {', '.join(SIGNATURES)}")
        signature = SIGNATURES[self.name]
        wanted = signature.arguments + signature.optional
        if not len(signature.arguments) <= len(self.args) <= len(wanted):
            takes = ", ".join([*signature.arguments, *(f"[{name}]" for name in signature.optional)])
            raise UserError(f"{self.name} takes ({takes}), found {len(self.args)} arguments; fix the call")
        for argument, value in zip(wanted, self.args, strict=False):
            if not isinstance(value, ARGUMENT_TYPES.get(argument, str)):
                raise UserError(f"{self.name}: {argument} cannot be {value!r}; write it as in {EXAMPLES[argument]}")
        if self.turn is not None:
            if not math.isfinite(self.turn):
                raise UserError(f"{self.name}: {self.turn} is not a turn; write degrees about the vertical, as 90")
            args = (*self.args[:-1], round(float(self.turn) % 360, 6))
            object.__setattr__(self, "args", args)
        for argument, value in zip(wanted, self.args, strict=False):
            if argument == "position" and not _is_position(value):
                raise UserError(
                    f"{self.name}: {value} is not a position; write three numbers in metres, as (0, 0, 0.1)"
                )
        if self.name == "gripper" and self.args[0] not in (OPEN, CLOSED):
            raise UserError(f"gripper({self.args[0]}) is unknown; write gripper(open) or gripper(closed)")
        if self.body is not None and (node := not_memoryless(self.body)) is not None:
            raise UserError(
                f"the subtask {self.label} holds {node.label}, which cannot be part of one leaf; "
                "write the tree in place of the subtask"
            )

    @property
    def kind(self) -> Kind:
        return SIGNATURES[self.name].kind

    @property
    def cost(self) -> float:
        """What running the action once costs, in arbitrary units; planners prefer cheap ones."""
        return SIGNATURES[self.name].cost

    def _argument(self, name: str) -> Argument | None:
        wanted = SIGNATURES[self.name].arguments + SIGNATURES[self.name].optional
        return self.args[wanted.index(name)] if name in wanted[: len(self.args)] else None

    @property
    def object(self) -> str | None:
        value = self._argument("object")
        return value if isinstance(value, str) else None

    @property
    def position(self) -> tuple[float, float, float] | None:
        value = self._argument("position")
        return value if isinstance(value, tuple) else None

    @property
    def frame(self) -> str | None:
        value = self._argument("frame")
        return value if isinstance(value, str) else None

    @property
    def turn(self) -> float | None:
        """Degrees about the vertical of the frame; None where the behavior does not say."""
        value = self._argument("turn")
        return value if isinstance(value, int | float) else None

    @property
    def body(self) -> Tree | None:
        """The tree of a subtask, as it was given; None for other behaviors."""
        value = self._argument("tree")
        return value if isinstance(value, Behavior | Control | ExtendedNode) else None

    def __str__(self) -> str:
        if not self.args:
            return self.name
        return f"{self.name}({', '.join(_argument_text(value) for value in self.args)})"

    __repr__ = __str__

    @property
    def label(self) -> str:
        """What drawings show: the text, but only the name of a subtask."""
        return str(self.args[0] if self.name == "subtask" else self)

    @property
    def preconditions(self) -> tuple[Behavior, ...]:
        """Conditions that must hold for the action to start, in the order in which to establish them."""
        if self.name == "pick":
            return (Behavior("gripper", (OPEN,)), Behavior("reachable", self.args), Behavior("clear", self.args))
        if self.name == "place":
            return (Behavior("holding", self.args[:1]),)
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
            case "approach":
                return (Behavior("reachable", self.args),)
            case "pick":
                return (Behavior("holding", self.args),)
            case "place":
                return (Behavior("at", self.args), nothing)
            case "look":
                return (Behavior("is_seen", self.args),)
            case _:
                return ()

    @property
    def within_reach(self) -> Behavior | None:
        """The condition that what the action takes, or where it puts it, is within reach of an arm that drives; None for
        other actions."""
        if self.name == "pick":
            return Behavior("reachable", self.args)
        if self.name == "place" and self.frame is not None and self.position is not None:
            return Behavior("reachable", (self.frame, self.position))
        return None

    @property
    def subtree(self) -> Tree | None:
        """What a gene stands for, without genes in it; None for other behaviors. `move` is that of the paper, figure 1, and
        `carry` the same with the drives that a pick and a place need."""
        if self.kind != Kind.GENE:
            return None
        if self.body is not None:
            return expand(self.body)
        box, pick, place = self.args[:1], Behavior("pick", self.args[:1]), Behavior("place", self.args)
        opened = Control.fallback(Behavior("gripper", (OPEN,)), Behavior("open_gripper"))
        driven = [_near(action) if self.name == "carry" else () for action in (pick, place)]
        held = Control.fallback(Behavior("holding", box), Control.sequence(opened, *driven[0], pick))
        return Control.fallback(Behavior("at", self.args), Control.sequence(held, *driven[1], place))


def _near(action: Behavior) -> tuple[Tree, ...]:
    """Return what drives to where an action is within reach."""
    condition = action.within_reach
    return () if condition is None else (Control.fallback(condition, Behavior("approach", condition.args)),)


Tree = Node[Behavior]
Argument = str | float | tuple[float, float, float] | Tree
ARGUMENT_TYPES: dict[str, type | tuple[type, ...]] = {
    "position": tuple,
    "turn": (int, float),
    "tree": (Behavior, Control, ExtendedNode),
}  # others are names
EXAMPLES = {
    **dict.fromkeys(("object", "position", "frame"), "at(Box, (0, 0, 0.1), Frame)"),
    **dict.fromkeys(("name", "tree"), "subtask(unstack, Sequence(...))"),
    "opening": "gripper(open)",
    "turn": "at(Box, (0, 0, 0.1), Frame, 90)",
    "subgoal": "reached(unstacked)",
}


def _is_position(values: Any) -> bool:
    numbers = all(isinstance(value, int | float | np.number) for value in values)
    return len(values) == 3 and numbers and bool(np.all(np.isfinite(values)))


def expand(tree: Tree) -> Tree:
    """Return the same tree with each gene replaced by the subtree that it stands for."""
    if isinstance(tree, Behavior):
        return tree.subtree or tree
    return dataclasses.replace(tree, children=tuple(map(expand, tree.children)))


def _argument_text(value: Argument) -> str:
    if isinstance(value, tuple):
        return f"({', '.join(np.format_float_positional(x, trim='-') for x in value)})"
    return np.format_float_positional(value, trim="-") if isinstance(value, int | float) else str(value)
