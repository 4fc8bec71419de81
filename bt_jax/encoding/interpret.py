"""Ticking one tree in plain Python: every node's status, for display and for programs that run a single tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from bt_jax.behaviors.nodes import Control, Kind, L, Node
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix

__all__ = ["TreeTick", "tick_tree"]


@dataclasses.dataclass(frozen=True)
class TreeTick:
    """One tick: the root's status, and that of each node in prefix order, None where it was not ticked."""

    status: Status
    statuses: tuple[Status | None, ...]

    @property
    def running(self) -> int | None:
        """Index of the leaf that is RUNNING, or None."""
        if self.status != Status.RUNNING:
            return None
        return max(i for i, status in enumerate(self.statuses) if status == Status.RUNNING)


def tick_tree(tree: Node[L], status_of: Callable[[L, int], Status]) -> TreeTick:
    """Tick a memoryless tree once. `status_of(leaf, index)` gives the status of a leaf (a gene is one); it is called
    for the leaves that are ticked only, in their order; `index` is the leaf's place in prefix order."""
    statuses: list[Status | None] = [None] * len(prefix(tree))

    def visit(node: Node[L], at: int) -> tuple[Status, int]:
        """Return the status of the node at index `at`, and the index after its subtree."""
        if not isinstance(node, Control):
            statuses[at] = status = status_of(node, at)
            return status, at + 1
        goes_on = Status.SUCCESS if node.kind == Kind.SEQUENCE else Status.FAILURE
        status, after = goes_on, at + 1
        for child in node.children:
            if status == goes_on:
                status, after = visit(child, after)
        statuses[at] = status
        return status, at + len(prefix(node))

    return TreeTick(visit(tree, 0)[0], tuple(statuses))
