"""Ticking one tree in plain Python: every node's status, for display and for programs that run a single tree.

Here also tick the nodes that arrays do not hold, as `Tree::tickOnce` of BehaviorTree.CPP 4 ticks them. What nodes remember
is not in the tree: a tick takes it and returns it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Generic

from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, L, Node
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import children, prefix

__all__ = ["DECORATED", "TreeMemory", "TreeTick", "tick_tree"]

TINY = 1e-9  # that sums of parts of a tick may be off
MAX_PASSES = 100  # of one tick, after which a loop without end goes on in the next one
SUCCESS, FAILURE, RUNNING = Status.SUCCESS, Status.FAILURE, Status.RUNNING


@dataclasses.dataclass(frozen=True)
class TreeMemory:
    """What the nodes of a tree remember between two ticks, by their index in prefix order."""

    running: frozenset[int] = frozenset()  # nodes that returned RUNNING
    counts: Mapping[int, int | float] = dataclasses.field(
        default_factory=dict
    )  # children that are done, or attempts, or cycles, or ticks
    started: Mapping[int, float] = dataclasses.field(default_factory=dict)  # s, when a Timeout began


@dataclasses.dataclass(frozen=True)
class TreeTick:
    """One tick: the root's status, that of each node in prefix order, None where it was not ticked or a `timeout` has halted
    it, and what the nodes remember afterwards."""

    status: Status
    statuses: tuple[Status | None, ...]
    memory: TreeMemory

    @property
    def running(self) -> int | None:
        """Index of the leaf that is RUNNING, or of the node that is while no leaf is, or None."""
        return max(self.memory.running) if self.status == Status.RUNNING else None


def tick_tree(
    tree: Node[L],
    status_of: Callable[[L, int], Status],
    memory: TreeMemory | None = None,
    *,
    time: float = 0.0,
    ticks: float = 1.0,
) -> TreeTick:
    """Tick a tree once. `status_of(leaf, index)` gives the status of a leaf (a gene is one); it is called for the leaves
    that are ticked only, in their order; `index` is the leaf's place in prefix order.

    `memory` is that of the tick before; a memoryless tree has none. `time` [s] is that of the clock of its Timeouts. For
    how many ticks this one counts in a `timeout` is `ticks`: less than one where a tree is ticked more often than it was
    learnt.
    """
    memory, passes = memory or TreeMemory(), 0
    while True:
        ticking = _Tick(tree, status_of, memory, time, ticks if passes == 0 else 0.0)
        status = ticking.visit(0)
        memory, passes = ticking.memory, passes + 1
        if status != RUNNING or not ticking.woken or passes == MAX_PASSES:
            return TreeTick(status, tuple(ticking.statuses), memory)


class _Tick(Generic[L]):
    """One pass over a tree. `woken` says that a loop has ended the pass only to let others have their turn: BehaviorTree.CPP
    then ticks again at once."""

    def __init__(
        self, tree: Node[L], status_of: Callable[[L, int], Status], memory: TreeMemory, time: float, ticks: float
    ) -> None:
        self.nodes, self.status_of, self.time, self.ticks = prefix(tree), status_of, time, ticks
        self.sizes = _sizes(tree)
        self.statuses: list[Status | None] = [None] * len(self.nodes)
        self.running, self.counts, self.started = set(memory.running), dict(memory.counts), dict(memory.started)
        self.woken = False

    @property
    def memory(self) -> TreeMemory:
        return TreeMemory(frozenset(self.running), self.counts, self.started)

    def visit(self, at: int) -> Status:
        node = self.nodes[at]
        if isinstance(node, Control):
            goes_on = SUCCESS if node.kind == Kind.SEQUENCE else FAILURE
            status = self._in_turn(at, goes_on, first=0)
        elif isinstance(node, ExtendedNode):
            status = self._extended(node, at)
        else:
            status = self.status_of(node, at)
        self.statuses[at] = status
        if status == RUNNING:
            self.running.add(at)
        else:
            self._halt(at)
        return status

    def _extended(self, node: ExtendedNode[L], at: int) -> Status:
        match node.name:
            case "ResumingSequence" | "ResumingFallback" | "SequenceWithMemory":
                goes_on = FAILURE if node.name == "ResumingFallback" else SUCCESS
                yields = node.name == "SequenceWithMemory"
                return self._in_turn(at, goes_on, first=int(self.counts.get(at, 0)), remembers=True, yields=yields)
            case "RetryUntilSuccessful":
                return self._loop(at, node.number, again=FAILURE)
            case "Repeat":
                return self._loop(at, node.number, again=SUCCESS)
            case "Timeout":
                return self._timeout(at, node.number)
            case "retry":
                return self._count(at, node.number, counted=FAILURE, step=1.0)
            case "timeout":
                return self._count(at, node.number, counted=RUNNING, step=self.ticks)
        status = self.visit(at + 1)
        return DECORATED[node.name].get(status, RUNNING)

    def _in_turn(
        self, at: int, goes_on: Status, *, first: int, remembers: bool = False, yields: bool = False
    ) -> Status:
        """Tick the children from the `first` on as long as they return `goes_on`; a child that runs halts the others. A node
        that `yields` gives others a turn after a child that was not running before."""
        places = self._children(at)
        for number, child in enumerate(places[first:], start=first):
            was_idle = child not in self.running
            status = self.visit(child)
            if remembers:
                self.counts[at] = number
            if status == RUNNING:
                for other in places:
                    if other != child:
                        self._halt(other)
            if status != goes_on:
                return status
            if yields and was_idle and child != places[-1]:
                self.counts[at], self.woken = number + 1, True
                return RUNNING
        self.counts.pop(at, None)
        return goes_on

    def _loop(self, at: int, limit: int | None, *, again: Status) -> Status:
        """Tick the child until it does not return `again`, up to `limit` times. A child that was not running before gives
        the others a turn after each round."""
        count = self.counts.get(at, 0)
        while True:
            was_idle = at + 1 not in self.running
            status = self.visit(at + 1)
            if status == again:
                count += 1
            self.counts[at] = count
            if status != again or count == limit:
                return status
            if was_idle:
                self.woken = True
                return RUNNING

    def _count(self, at: int, limit: int | None, *, counted: Status, step: float) -> Status:
        """Tick the child, and return RUNNING for `counted` until the count reaches the limit, then FAILURE."""
        status, count = self.visit(at + 1), self.counts.get(at, 0)
        if status != counted:
            self.counts[at] = count
            return status
        self.counts[at] = count + step
        if limit is None or count + step < limit - TINY:
            return RUNNING
        if counted == RUNNING:
            self.statuses[at + 1 : at + self.sizes[at]] = [None] * (self.sizes[at] - 1)
        return FAILURE

    def _timeout(self, at: int, milliseconds: int | None) -> Status:
        """Tick the child, and fail if it was still running when its time was over. 0 is no limit."""
        started = self.started.setdefault(at, self.time)
        if milliseconds and at + 1 in self.running and self.time - started >= milliseconds / 1000:
            return FAILURE
        return self.visit(at + 1)

    def _children(self, at: int) -> list[int]:
        places, place = [], at + 1
        while place < at + self.sizes[at]:
            places.append(place)
            place += self.sizes[place]
        return places

    def _halt(self, at: int) -> None:
        """Forget what a node and those below it remember; a SequenceWithMemory keeps its place."""
        for i in range(at, at + self.sizes[at]):
            self.running.discard(i)
            self.started.pop(i, None)
            node = self.nodes[i]
            if not (isinstance(node, ExtendedNode) and node.name == "SequenceWithMemory"):
                self.counts.pop(i, None)


DECORATED = {
    "Inverter": {SUCCESS: FAILURE, FAILURE: SUCCESS},
    "ForceSuccess": {SUCCESS: SUCCESS, FAILURE: SUCCESS},
    "ForceFailure": {SUCCESS: FAILURE, FAILURE: FAILURE},
    "KeepRunningUntilFailure": {SUCCESS: RUNNING, FAILURE: FAILURE},
}  # what a decorator returns for what its child returns; RUNNING stays RUNNING


def _sizes(tree: Node[L]) -> list[int]:
    """Return the number of nodes of each subtree, in prefix order."""
    sizes: list[int] = []

    def visit(node: Node[L]) -> None:
        at = len(sizes)
        sizes.append(0)
        for child in children(node):
            visit(child)
        sizes[at] = len(sizes) - at

    visit(tree)
    return sizes
