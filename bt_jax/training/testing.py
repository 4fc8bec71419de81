"""Tests of a tree in episodes that it never saw."""

from __future__ import annotations

import dataclasses

import numpy as np

from bt_jax.behaviors import Tree
from bt_jax.mjx_env.episodes.diagnosis import explain_failure
from bt_jax.mjx_env.episodes.evaluator import Evaluation
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take
from bt_jax.training.result import EXPLAINED, Failures, Test

__all__ = ["as_test", "explained"]


def as_test(evaluation: Evaluation, rows: int, *, draws: int) -> Test:
    """Return the test whose episodes are the first `rows` of an evaluation."""
    struck = None if evaluation.struck is None else evaluation.struck.reshape(-1)[:rows]
    return Test(evaluation.solved.reshape(-1)[:rows], evaluation.values.reshape(-1)[:rows], draws=draws, struck=struck)


def explained(
    test: Test, semantics: LeafSemantics, settler: Settler, tree: Tree, layouts: World, fates: Fates | None
) -> Test:
    """Return a test with the reasons for which the tree does not solve the first of the episodes that it does not: each is
    played again from its layout, with its fate."""
    reasons: dict[str, list[int]] = {}
    for k in np.flatnonzero(~test.solved)[:EXPLAINED].tolist():
        row = slice(k, k + 1)
        playback = play(semantics, settler, tree, take(layouts, row), None if fates is None else fates[row])
        if not playback.solved:
            reasons.setdefault(explain_failure(semantics.task, playback), []).append(k)
    found = [Failures(reason, *test.numbers(rows)) for reason, rows in reasons.items()]
    return dataclasses.replace(test, failures=tuple(sorted(found, key=lambda failures: -len(failures.layouts))))
