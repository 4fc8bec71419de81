"""Trees as py_trees objects, to be used in py_trees programs and as the oracle in tests."""

from __future__ import annotations

from collections.abc import Callable

from py_trees import decorators
from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Selector, Sequence

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, ExtendedNode, Kind, Tree, expand
from bt_jax.encoding.walk import children

__all__ = ["Leaf", "TimeoutInTicks", "to_py_trees"]


class Leaf(Behaviour):
    """A condition, an action or a gene; its status comes from `status_of` whenever it is ticked."""

    def __init__(self, behavior: Behavior, status_of: Callable[[Behavior], Status]):
        super().__init__(name=behavior.label)
        self.behavior = behavior
        self.status_of = status_of

    def update(self) -> Status:
        return self.status_of(self.behavior)


class TimeoutInTicks(decorators.Decorator):
    """A `timeout`: fails in the `num_ticks`-th tick in a row in which its child is RUNNING, and stops it."""

    def __init__(self, name: str, child: Behaviour, num_ticks: int) -> None:
        super().__init__(name=name, child=child)
        self.num_ticks, self.ticks = num_ticks, 0

    def initialise(self) -> None:
        self.ticks = 0

    def update(self) -> Status:
        self.ticks += self.decorated.status == Status.RUNNING
        return Status.FAILURE if self.ticks == self.num_ticks else self.decorated.status


def to_py_trees(tree: Tree, status_of: Callable[[Behavior], Status], *, expand_genes: bool = False) -> Behaviour:
    """Return the tree with memoryless Sequence and Selector composites (our Fallback is py_trees' Selector).

    Other nodes become those that py_trees has for the purpose: composites with memory, and decorators; `retry` is its Retry.
    Its loops make one round a tick, and its Timeout measures real time from the first tick, so that `timeout` becomes a
    `TimeoutInTicks`. Raise UserError where it has none.

    `status_of(behavior)` is called each time that a leaf is ticked and returns its status. A gene is one leaf, unless
    `expand_genes` puts its subtree in its place. `tick_once()` of the root ticks the tree.
    """
    if expand_genes:
        tree = expand(tree)
    if isinstance(tree, Behavior):
        return Leaf(tree, status_of)
    nodes = [to_py_trees(child, status_of) for child in children(tree)]
    if isinstance(tree, ExtendedNode):
        return _extended(tree, nodes)
    if tree.kind == Kind.SEQUENCE:
        return Sequence(name="Sequence", memory=False, children=nodes)
    return Selector(name="Fallback", memory=False, children=nodes)


def _extended(node: ExtendedNode[Behavior], nodes: list[Behaviour]) -> Behaviour:
    name, number = node.label, node.number
    match node.name:
        case "ResumingSequence":
            return Sequence(name=name, memory=True, children=nodes)
        case "ResumingFallback":
            return Selector(name=name, memory=True, children=nodes)
        case "retry" if number is not None:
            return decorators.Retry(name=name, child=nodes[0], num_failures=number)
        case "timeout" if number is not None:
            return TimeoutInTicks(name=name, child=nodes[0], num_ticks=number)
        case "RetryUntilSuccessful" if number is not None and number > 0:
            return decorators.Retry(name=name, child=nodes[0], num_failures=number)
        case "Repeat" if number is not None:
            return decorators.Repeat(name=name, child=nodes[0], num_success=number)
        case "Timeout" if number:
            return decorators.Timeout(name=name, child=nodes[0], duration=number / 1000)
    if node.name not in DECORATORS:
        raise UserError(f"py_trees has no {node.label}; replace it, for instance by a ResumingSequence or a limit")
    return DECORATORS[node.name](name=name, child=nodes[0])


DECORATORS: dict[str, Callable[..., Behaviour]] = {
    "Inverter": decorators.Inverter,
    "ForceSuccess": decorators.FailureIsSuccess,
    "ForceFailure": decorators.SuccessIsFailure,
    "KeepRunningUntilFailure": decorators.SuccessIsRunning,
}
