"""The nodes of Behavior Trees in any domain: control nodes, and leaves that are known by their kind only."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar, Union, runtime_checkable

from bt_jax._util.errors import UserError

__all__ = [
    "EXTENDED",
    "Control",
    "Drawing",
    "ExtendedKind",
    "ExtendedNode",
    "Kind",
    "L",
    "Leaf",
    "Node",
    "Symbol",
    "not_memoryless",
]


class Kind(enum.IntEnum):
    """What a token is. The order is that of the tokens in a vocabulary."""

    PAD = 0
    SEQUENCE = 1
    FALLBACK = 2
    CONDITION = 3
    ACTION = 4
    GENE = 5


@runtime_checkable
class Leaf(Protocol):
    """A condition, an action or a gene: hashable, compares by value, and `str` is its notation."""

    @property
    def kind(self) -> Kind: ...

    @property
    def label(self) -> str:
        """What drawings show."""
        ...


@dataclasses.dataclass(frozen=True, repr=False)
class Symbol:
    """A leaf that is only a name: enough for a domain of your own, where you say what the name means."""

    name: str
    kind: Kind

    @property
    def label(self) -> str:
        return self.name

    def __str__(self) -> str:
        return self.name

    __repr__ = __str__


L = TypeVar("L", bound=Leaf)


@dataclasses.dataclass(frozen=True, repr=False)
class Control(Generic[L]):
    """A control node with its children; memoryless: each tick starts at the first child."""

    kind: Kind
    children: tuple[Node[L], ...]

    @staticmethod
    def sequence(*children: Node[L]) -> Control[L]:
        return Control(Kind.SEQUENCE, children)

    @staticmethod
    def fallback(*children: Node[L]) -> Control[L]:
        return Control(Kind.FALLBACK, children)

    def __str__(self) -> str:
        return f"{self.kind.name.title()}({', '.join(map(str, self.children))})"

    __repr__ = __str__

    def _repr_svg_(self) -> str | None:
        """Return the drawing that a notebook shows."""
        return None if Drawing.to_svg is None else Drawing.to_svg(self)


@dataclasses.dataclass(frozen=True)
class ExtendedKind:
    """What all nodes of one name have in common: their tag in BehaviorTree.CPP XML, the port of their number there, whether
    they decorate one child, and whether a tick depends on the current statuses of the leaves alone."""

    tag: str
    port: str | None = None
    one_child: bool = True
    memoryless: bool = False


EXTENDED: dict[str, ExtendedKind] = {
    "ResumingSequence": ExtendedKind("Sequence", one_child=False),
    "ResumingFallback": ExtendedKind("Fallback", one_child=False),
    "SequenceWithMemory": ExtendedKind("SequenceWithMemory", one_child=False),
    "Inverter": ExtendedKind("Inverter", memoryless=True),
    "ForceSuccess": ExtendedKind("ForceSuccess", memoryless=True),
    "ForceFailure": ExtendedKind("ForceFailure", memoryless=True),
    "RetryUntilSuccessful": ExtendedKind("RetryUntilSuccessful", port="num_attempts"),
    "Repeat": ExtendedKind("Repeat", port="num_cycles"),
    "Timeout": ExtendedKind("Timeout", port="msec"),
    "KeepRunningUntilFailure": ExtendedKind("KeepRunningUntilFailure"),  # is RUNNING while no action runs
}


@dataclasses.dataclass(frozen=True, repr=False)
class ExtendedNode(Generic[L]):
    """A node beyond the memoryless Sequence and Fallback, with the meaning that BehaviorTree.CPP gives to it: a control
    node with memory, or a decorator. Arrays do not hold it; `encoding.interpret` ticks it.

    `number` is that of attempts or cycles, -1 for no limit, or the milliseconds of a Timeout. Raise UserError if the number
    or the children do not fit the name.
    """

    name: str
    children: tuple[Node[L], ...]
    number: int | None = None

    def __post_init__(self) -> None:
        port, least = self.meaning.port, 0 if self.name == "Timeout" else 1
        if self.meaning.one_child and len(self.children) != 1:
            raise UserError(
                f"{self.name} has {len(self.children)} children; give it one, for instance a Sequence of several"
            )
        if not self.children:
            raise UserError(f"{self.name} has no children; give it some, or delete it")
        if port is None and self.number is not None:
            raise UserError(f"{self.name} takes no number; delete {self.number}")
        if port is not None and self.number is None:
            raise UserError(
                f"{self.name} needs its {port}; write it as in {self.name}({2500 if least == 0 else 3}, ...)"
            )
        if self.number is not None and not (least <= self.number < 2**31 or (self.number == -1 and least == 1)):
            raise UserError(f"{self.name}: {port} cannot be {self.number}; {RANGES[least]}")

    @property
    def meaning(self) -> ExtendedKind:
        return EXTENDED[self.name]

    @property
    def label(self) -> str:
        """What drawings show."""
        number = {None: "", -1: " without limit"}.get(self.number, f" {self.number}")
        return f"{self.name}{number}{' ms' if self.name == 'Timeout' else ''}"

    def __str__(self) -> str:
        number = [] if self.number is None else [str(self.number)]
        return f"{self.name}({', '.join([*number, *map(str, self.children)])})"

    __repr__ = __str__


RANGES = ("give milliseconds up to 2147483647, 0 for no limit", "give 1 to 2147483647, or -1 for no limit")
Node = Union[L, Control[L], ExtendedNode[L]]  # noqa: UP007  subscriptable: Node[Symbol] is a tree of symbols


def not_memoryless(tree: Node[L]) -> ExtendedNode[L] | None:
    """Return the first node in prefix order whose tick does not depend on the current statuses of the leaves alone."""
    if isinstance(tree, ExtendedNode) and not tree.meaning.memoryless:
        return tree
    below = tree.children if isinstance(tree, Control | ExtendedNode) else ()
    return next((found for child in below if (found := not_memoryless(child)) is not None), None)


class Drawing:
    """How trees draw themselves. Drawing lies above the nodes, so the package says it when it is imported."""

    to_svg: Callable[[Any], str] | None = None
