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
    "Decorator",
    "Drawing",
    "ExtendedKind",
    "ExtendedNode",
    "Kind",
    "L",
    "Leaf",
    "Node",
    "Symbol",
    "not_memoryless",
    "not_reactive",
]


class Kind(enum.IntEnum):
    """What a token is. The order is that of the tokens in a vocabulary."""

    PAD = 0
    SEQUENCE = 1
    FALLBACK = 2
    CONDITION = 3
    ACTION = 4
    GENE = 5
    RETRY = 6
    TIMEOUT = 7


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
class Decorator:
    """What a decorator that arrays hold counts, and up to what: a RETRY the failures of its child, a TIMEOUT the ticks in a
    row in which its child is RUNNING."""

    kind: Kind
    number: int


@dataclasses.dataclass(frozen=True)
class ExtendedKind:
    """What all nodes of one name have in common: their tag in BehaviorTree.CPP XML, the port of their number there, whether
    they decorate one child, whether a tick depends on the current statuses of the leaves alone, and their kind in arrays,
    None if arrays do not hold them."""

    tag: str
    port: str | None = None
    one_child: bool = True
    memoryless: bool = False
    kind: Kind | None = None


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
    "retry": ExtendedKind("RetryOverTicks", port="num_attempts", kind=Kind.RETRY),
    "timeout": ExtendedKind("TimeoutInTicks", port="num_ticks", kind=Kind.TIMEOUT),
}


@dataclasses.dataclass(frozen=True)
class Range:
    """The numbers that a node takes."""

    least: int
    most: int
    unlimited: int | None  # the number that stands for no limit
    example: int
    remedy: str


MOST = 2**31 - 1
TICKS = Range(1, 255, None, 3, "give 1 to 255")
MILLISECONDS = Range(0, MOST, 0, 2500, f"give milliseconds up to {MOST}, 0 for no limit")
TIMES = Range(1, MOST, -1, 3, f"give 1 to {MOST}, or -1 for no limit")


@dataclasses.dataclass(frozen=True, repr=False)
class ExtendedNode(Generic[L]):
    """A node beyond the memoryless Sequence and Fallback: a control node with memory, or a decorator.

    `retry` and `timeout` count over ticks: `retry` returns RUNNING in place of FAILURE until the `number`-th one, `timeout`
    fails in the `number`-th tick in a row in which its child is RUNNING. Both forget in a tick in which they do not return
    RUNNING, or are not ticked. Arrays hold these two. The others mean what they mean in BehaviorTree.CPP, and
    `encoding.interpret` ticks them; their `number` is that of attempts or cycles, -1 for no limit, or the milliseconds of a
    Timeout. Raise UserError if the number or the children do not fit the name.
    """

    name: str
    children: tuple[Node[L], ...]
    number: int | None = None

    def __post_init__(self) -> None:
        port, numbers = self.meaning.port, self._numbers
        if self.meaning.one_child and len(self.children) != 1:
            raise UserError(
                f"{self.name} has {len(self.children)} children; give it one, for instance a Sequence of several"
            )
        if not self.children:
            raise UserError(f"{self.name} has no children; give it some, or delete it")
        if port is None and self.number is not None:
            raise UserError(f"{self.name} takes no number; delete {self.number}")
        if port is not None and self.number is None:
            raise UserError(f"{self.name} needs its {port}; write it as in {self.name}({numbers.example}, ...)")
        if self.number is not None and not (
            numbers.least <= self.number <= numbers.most or self.number == numbers.unlimited
        ):
            raise UserError(f"{self.name}: {port} cannot be {self.number}; {numbers.remedy}")

    @property
    def meaning(self) -> ExtendedKind:
        return EXTENDED[self.name]

    @property
    def _numbers(self) -> Range:
        if self.meaning.kind is not None:
            return TICKS
        return MILLISECONDS if self.name == "Timeout" else TIMES

    @property
    def decorator(self) -> Decorator | None:
        """What arrays hold of this node besides its child; None if they do not hold it."""
        if self.meaning.kind is None or self.number is None:
            return None
        return Decorator(self.meaning.kind, self.number)

    @property
    def label(self) -> str:
        """What drawings show."""
        number = {None: "", -1: " without limit"}.get(self.number, f" {self.number}")
        unit = {"Timeout": " ms", "timeout": " ticks"}.get(self.name, "")
        return f"{self.name}{number}{unit}"

    def __str__(self) -> str:
        number = [] if self.number is None else [str(self.number)]
        return f"{self.name}({', '.join([*number, *map(str, self.children)])})"

    __repr__ = __str__


Node = Union[L, Control[L], ExtendedNode[L]]  # noqa: UP007  subscriptable: Node[Symbol] is a tree of symbols


def not_memoryless(tree: Node[L]) -> ExtendedNode[L] | None:
    """Return the first node in prefix order whose tick does not depend on the current statuses of the leaves alone."""
    return _first_extended(tree, lambda node: not node.meaning.memoryless)


def not_reactive(tree: Node[L]) -> ExtendedNode[L] | None:
    """Return the first node in prefix order that remembers which child comes next, or what it did within a tick, so that a
    tree that is ticked on after its SUCCESS begins from the start; a tree that counts ticks does not."""
    return _first_extended(tree, lambda node: not node.meaning.memoryless and node.decorator is None)


def _first_extended(tree: Node[L], wanted: Callable[[ExtendedNode[L]], bool]) -> ExtendedNode[L] | None:
    if isinstance(tree, ExtendedNode) and wanted(tree):
        return tree
    below = tree.children if isinstance(tree, Control | ExtendedNode) else ()
    return next((found for child in below if (found := _first_extended(child, wanted)) is not None), None)


class Drawing:
    """How trees draw themselves. Drawing lies above the nodes, so the package says it when it is imported."""

    to_svg: Callable[[Any], str] | None = None
