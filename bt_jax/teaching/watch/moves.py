"""What a person did, as it was seen: moves, where everything was, and what is in doubt."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Literal

from bt_jax.teaching.watch.rest import Rest

__all__ = ["Decision", "Doubt", "DoubtKind", "Kind", "Move", "Watched"]

Kind = Literal["carried", "bumped", "returned"]
DoubtKind = Literal["together", "twice", "bumped", "lost"]
Decision = Literal["keep", "leave out", "again"]


@dataclasses.dataclass(frozen=True)
class Move:
    """A body that was at rest `before`, and `after` at another place, `under` it what it stands on. It was `carried`, or
    only `bumped`, or it `returned` to where it was. It was first seen away from its place at `left`, and at rest since
    `came` [s]."""

    box: str
    kind: Kind
    before: Rest
    after: Rest
    under: str
    left: float
    came: float


@dataclasses.dataclass(frozen=True)
class Doubt:
    """Something about which a person decides. `moves` are indices; `usual` is what is decided unless somebody says
    otherwise. To "keep" takes the moves, or the demonstration, as they were seen; to "leave out" drops the first of the
    moves, both of those that were made together, or the demonstration if a body was lost; "again" watches it again."""

    kind: DoubtKind
    text: str
    moves: tuple[int, ...]
    usual: Decision


@dataclasses.dataclass(frozen=True)
class Watched:
    """A demonstration as it was seen: where every body was at the `start` (nothing if it never began), and then the `moves`,
    in the order in which they came to rest."""

    start: Mapping[str, Rest]
    moves: tuple[Move, ...]
    doubts: tuple[Doubt, ...]
