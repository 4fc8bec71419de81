"""What a person has said about demonstrations, in place of what is inferred from them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

__all__ = ["Corrections", "Instance"]


@dataclasses.dataclass(frozen=True)
class Instance:
    """Which action of which demonstration, both counted from 0."""

    demonstration: int
    index: int


@dataclasses.dataclass(frozen=True)
class Corrections:
    """Answers of a person, by the actions that they are about.

    `frames`: what a place is relative to. `turns`: how the object lies there, degrees, None where any turn will do.
    `orders`: whether it is meant that one placement of a demonstration comes before another. `itself`: whether an instance
    of a part is meant itself, by its name, or any of the part.
    """

    frames: Mapping[Instance, str] = dataclasses.field(default_factory=dict)
    turns: Mapping[Instance, float | None] = dataclasses.field(default_factory=dict)
    orders: Mapping[tuple[Instance, Instance], bool] = dataclasses.field(default_factory=dict)
    itself: Mapping[str, bool] = dataclasses.field(default_factory=dict)

    def __or__(self, other: Corrections) -> Corrections:
        """Return both; where both say something, the other counts."""
        return Corrections(
            {**self.frames, **other.frames},
            {**self.turns, **other.turns},
            {**self.orders, **other.orders},
            {**self.itself, **other.itself},
        )

    def without(self, other: Corrections) -> Corrections:
        """Return what is left once everything that the other speaks of is taken back."""
        return Corrections(
            {key: value for key, value in self.frames.items() if key not in other.frames},
            {key: value for key, value in self.turns.items() if key not in other.turns},
            {key: value for key, value in self.orders.items() if key not in other.orders},
            {key: value for key, value in self.itself.items() if key not in other.itself},
        )

    @property
    def demonstrations(self) -> frozenset[int]:
        """The demonstrations that they are about, by their numbers."""
        instances = [*self.frames, *self.turns, *(one for pair in self.orders for one in pair)]
        return frozenset(one.demonstration for one in instances)

    def renumbered(self, numbers: Mapping[int, int]) -> Corrections:
        """Return them for demonstrations with other numbers, without those of demonstrations that have none."""

        def new(one: Instance) -> Instance:
            return Instance(numbers[one.demonstration], one.index)

        return Corrections(
            {new(one): frame for one, frame in self.frames.items() if one.demonstration in numbers},
            {new(one): turn for one, turn in self.turns.items() if one.demonstration in numbers},
            {(new(a), new(b)): meant for (a, b), meant in self.orders.items() if a.demonstration in numbers},
            self.itself,
        )
