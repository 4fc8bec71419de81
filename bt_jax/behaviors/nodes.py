"""The nodes of Behavior Trees in any domain: control nodes, and leaves that are known by their kind only."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar, Union, runtime_checkable

__all__ = ["Control", "Drawing", "Kind", "L", "Leaf", "Node", "Symbol"]


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


Node = Union[L, Control[L]]  # noqa: UP007  subscriptable: Node[Symbol] is a tree of symbols


class Drawing:
    """How trees draw themselves. Drawing lies above the nodes, so the package says it when it is imported."""

    to_svg: Callable[[Any], str] | None = None
