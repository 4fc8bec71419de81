"""Tests of a tree in episodes that it never saw."""

from __future__ import annotations

import dataclasses

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree
from bt_jax.mjx_env.episodes.diagnosis import explain_failure
from bt_jax.mjx_env.episodes.evaluator import Evaluation
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.faults.fates import Fates, sample_fates
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take
from bt_jax.tasks import Task
from bt_jax.training.result import EXPLAINED, Failures, Test
from bt_jax.training.run_config import RunConfig
from bt_jax.training.settings import UNSEEN

__all__ = ["as_test", "episode_of_test", "explained"]


def episode_of_test(task: Task, config: RunConfig, layout: int, draw: int) -> tuple[World, Fates | None]:
    """Return where an episode of the test of a run starts, and its fate in a task where things go wrong, batches of one;
    layouts and draws are numbered from 1. Raise UserError if the test had no such layout."""
    count, seed, index = config.settings.test_layouts, [UNSEEN, config.gp.seed], layout - 1
    if not 0 <= index < count:
        raise UserError(f"there is no layout {layout} in the test; choose 1 to {count}")
    fates = sample_fates(task, seed, layouts=range(index, layout), draws=range(draw - 1, draw))
    return take(sample_layouts(task, seed, count), slice(index, layout)), fates


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
