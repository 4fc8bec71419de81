"""Where the trees come from that are tested, and how they are tested."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool

from bt_jax.behaviors import Behavior, Tree, Vocabulary
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import decorators, leaves
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Demonstrations, Frames, learn, plan_task
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.faults.fates import sample_episodes
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Faults, Task, with_faults
from bt_jax.tasks.faults import FAULTS, only
from bt_jax.teaching.script import parse_script, record
from bt_jax.training.levels import make_level
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

__all__ = ["ALL", "CONDITIONS", "MODELS", "SEEDED", "Model", "known", "make", "solved"]

Model = Literal["evolved_without", "evolved_with", "planned_without", "planned_with", "demonstrated"]
MODELS: tuple[Model, ...] = ("evolved_without", "evolved_with", "planned_without", "planned_with", "demonstrated")
SEEDED: tuple[Model, ...] = ("evolved_without", "evolved_with", "demonstrated")  # that differ from seed to seed
ALL, NONE = "all", "none"
CONDITIONS = (NONE, *FAULTS, ALL)
TESTED = 1 << 24  # seed of the layouts and draws in which trees are tested
NOISE = 0.003  # with which the scripted person misses each place, along each axis, metres


def known(faults: Faults, held_out: tuple[str, ...]) -> Faults:
    """Return the faults without those that only the tests have."""
    return only(faults, *(name for name in FAULTS if name not in held_out))


def make(model: Model, task: Task, faults: Faults, seed: int) -> Tree:
    """Return a tree for a task without faults: evolved or planned with these, or without any, or learned from
    demonstrations, in which nothing goes wrong."""
    if model == "demonstrated":
        return _demonstrated(task, seed)
    if model in ("evolved_with", "planned_with"):
        task = with_faults(task, faults)
    if model in ("planned_without", "planned_with"):
        return plan_task(task)
    training = Training(task, GPConfig(seed=seed))
    *_, last = training.evolution.run()
    return training.best_tree(last)


def _demonstrated(task: Task, seed: int) -> Tree:
    """Return what is learned where a person puts each object at its target, in the order of the targets."""
    steps = [
        f"pick {target.object}; to {target.position} {target.frame}{_turn(target.turn)}; release"
        for target in task.targets
    ]
    script, level = parse_script("\n".join(steps)), make_level(task, Settings())
    recorded = record(task, level, script, seed=3 * seed, noise=NOISE)
    return learn(Demonstrations(Frames.of(task), tuple(recorded)), task).tree


def _turn(turn: float | None) -> str:
    return "" if turn is None else f" {turn:g}"


def solved(
    task: Task, faults: Faults, condition: str, trees: Sequence[Tree], *, layouts: int, draws: int
) -> Bool[np.ndarray, "P K"]:
    """Return which of the episodes of a test each of the trees solves, the draws of one layout side by side; the same
    episodes for all trees, which share a transition table. Where nothing goes wrong, all draws are the same."""
    tested = with_faults(task, _condition(faults, condition))
    starts, fates = sample_episodes(tested, TESTED, layouts=layouts, draws=draws)
    vocabulary: Vocabulary[Behavior] = Vocabulary.of([])
    for tree in trees:
        vocabulary = vocabulary.extended(leaves(tree), decorators(tree))
    evaluator = TableEvaluator(LeafSemantics(tested, vocabulary), make_level(tested, Settings()), batch=1)
    return evaluator(encode_all(trees, vocabulary, MAX_NODES), starts, fates=fates).solved


def _condition(faults: Faults, condition: str) -> Faults:
    if condition == ALL:
        return faults
    return only(faults, *(() if condition == NONE else (condition,)))
