"""What the search for achievements has to know of a task: which leaves concern which box, and what can be achieved.

Where the targets are is not part of it.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Int32

from bt_jax.behaviors import FIRST_LEAF, Behavior, Kind, Vocabulary
from bt_jax.encoding.walk import leaves
from bt_jax.gp.achievements.goals import Goals, Measured
from bt_jax.mjx_env.episodes.evaluator import Evaluation
from bt_jax.tasks import Task

__all__ = ["enough", "goals_of", "measured"]

NONE = -1
MOST = 0.5  # of the episodes


def goals_of(task: Task, vocabulary: Vocabulary[Behavior]) -> Goals:
    """Return the targets of a task, then its subgoals, and the groups of leaves: the genes of each kind of object, and one
    group of those that concern several. Before a gene it may help to look for what it moves, and for where that goes."""
    kinds = _kinds(task)
    guards = {leaf.args[0]: vocabulary.token(leaf) for leaf in vocabulary.leaves if leaf.name == "reached"}
    group = [NONE] * FIRST_LEAF + [_group(leaf, kinds) for leaf in vocabulary.leaves]
    group += [NONE] * len(vocabulary.decorators)
    return Goals(
        group=np.array(group, np.int32),
        concerns=np.array([kinds[target.object] for target in task.targets] + [NONE] * len(task.subgoals), np.int32),
        guard=np.array([0] * len(task.targets) + [guards.get(subgoal.name, 0) for subgoal in task.subgoals], np.int32),
        node_cost=task.weights.node,
        often=enough(task),
        before=_looks(vocabulary),
    )


def _looks(vocabulary: Vocabulary[Behavior]) -> Int32[np.ndarray, "V 2"]:
    """Return the tokens of what looks for the object and for the frame of each leaf that acts, 0 for none."""
    looks = {leaf.object: vocabulary.token(leaf) for leaf in vocabulary.leaves if leaf.name == "look"}
    found = np.zeros((len(vocabulary), 2), np.int32)
    for leaf in vocabulary.leaves:
        if leaf.kind != Kind.CONDITION and leaf.name != "look":
            found[vocabulary.token(leaf)] = looks.get(leaf.object, 0), looks.get(leaf.frame, 0)
    return found


def _kinds(task: Task) -> dict[str, int]:
    """Return the index of the kind, of `Task.kinds`, of everything that a leaf may call an object."""
    return {name: task.kinds.index(task.thing(name).part or name) for name in task.instances}


def _group(leaf: Behavior, kinds: Mapping[str, int]) -> int:
    """Return the index of the kind of object that a gene moves, one more than the last for a gene that moves several,
    and -1 for other leaves."""
    if leaf.kind != Kind.GENE or leaf.subtree is None:
        return NONE
    moved = {kinds[str(atom.object)] for atom in leaves(leaf.subtree) if atom.name == "place"}
    return moved.pop() if len(moved) == 1 else max(kinds.values()) + 1


def enough(task: Task) -> float:
    """Return in which share of the episodes something has to be achieved to count as achieved: in all, or, where things go
    wrong, in most."""
    return 1.0 if task.faults is None else MOST


def measured(evaluation: Evaluation, task: Task, shape: tuple[int, int], *, robust: float = 1.0) -> Measured:
    """Return what the episodes of R times P trees tell the search; `shape` is (R, P). Fitness is the mean of the share
    `robust` of the episodes, the worst ones."""
    assert evaluation.trace is not None
    weights, misses = task.weights, evaluation.misses
    achieved = np.concatenate([misses.met, evaluation.reached], axis=-1).mean(axis=1, dtype=np.float32)
    off = weights.distance * misses.distance + weights.turn * misses.turn
    missed = np.concatenate([off, weights.subgoal * ~evaluation.reached], axis=-1).mean(axis=1, dtype=np.float32)
    return Measured(
        fitness=evaluation.lower_mean(robust).reshape(shape),
        solved=evaluation.solved.mean(axis=1, dtype=np.float32).reshape(shape),
        achieved=achieved.reshape(*shape, achieved.shape[-1]),
        missed=missed.reshape(*shape, missed.shape[-1]),
        trace=np.bitwise_or.reduce(evaluation.trace, axis=1).reshape(*shape, evaluation.trace.shape[-1]),
    )
