"""Which of several overlapping groups explain a set best."""

from __future__ import annotations

import heapq
from collections.abc import Mapping

__all__ = ["best_packing"]

Group = frozenset[int]
WIDTH = 300  # partial packings that are kept at each step


def best_packing(values: Mapping[Group, float]) -> tuple[Group, ...]:
    """Return the disjoint groups whose values have the greatest sum; members of none of them count nothing.

    Dynamic programming over the members. Weighted set packing is hard in general, so that only the best `WIDTH` partial
    packings are kept at each step: exact for few groups, near it for hundreds.
    """
    beginning: dict[int, list[tuple[int, Group]]] = {}
    for group in values:
        beginning.setdefault(min(group), []).append((sum(1 << member for member in group), group))
    # For each set of members that are taken, as bits: the best sum so far, and its groups.
    states: dict[int, tuple[float, tuple[Group, ...]]] = {0: (0.0, ())}
    for member in sorted(beginning):
        new: dict[int, tuple[float, tuple[Group, ...]]] = {}
        for taken, (value, groups) in states.items():
            options = [(taken, value, groups)]
            for bits, group in beginning[member]:
                if not bits & taken:
                    options.append((taken | bits, value + values[group], (*groups, group)))
            for bits, total, chosen in options:
                later = bits >> (member + 1) << (member + 1)  # those before are decided
                if later not in new or total > new[later][0]:
                    new[later] = (total, chosen)
        states = dict(heapq.nlargest(WIDTH, new.items(), key=lambda state: state[1][0]))
    return max(states.values(), key=lambda state: state[0])[1]
