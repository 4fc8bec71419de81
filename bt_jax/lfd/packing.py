"""Which of several overlapping groups explain a set best."""

from __future__ import annotations

from collections.abc import Mapping

__all__ = ["best_packing"]

Group = frozenset[int]


def best_packing(values: Mapping[Group, float]) -> tuple[Group, ...]:
    """Return the disjoint groups whose values have the greatest sum; members of none of them count nothing.

    Exact, by dynamic programming over the members: weighted set packing is hard in general, but groups of placements are
    few and mostly nested.
    """
    beginning: dict[int, list[Group]] = {}
    for group in values:
        beginning.setdefault(min(group), []).append(group)
    # For each set of members still to come that are taken already: the best sum so far, and its groups.
    states: dict[Group, tuple[float, tuple[Group, ...]]] = {frozenset(): (0.0, ())}
    for member in sorted(beginning):
        new: dict[Group, tuple[float, tuple[Group, ...]]] = {}
        for taken, (value, groups) in states.items():
            options = [(taken, value, groups)]
            options += [
                (taken | group, value + values[group], (*groups, group))
                for group in beginning[member]
                if not group & taken
            ]
            for union, total, chosen in options:
                later = frozenset(other for other in union if other > member)
                if later not in new or total > new[later][0]:
                    new[later] = (total, chosen)
        states = new
    return max(states.values(), key=lambda state: state[0])[1]
