"""How a tree is found: by planning, or by evolution where planning does not do; and what the best so far still lacks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted
from bt_jax.app.plain_words import Words
from bt_jax.app.processes.train_command import ANYWHERE, Beginning
from bt_jax.app.state.run_record import failures
from bt_jax.behaviors import Tree, Vocabulary
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.walk import leaves
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import plan_task
from bt_jax.mjx_env.episodes.diagnosis import explain_failure
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.faults.fates import sample_episodes
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Task
from bt_jax.training.run_config import RunConfig

__all__ = ["STUCK", "Lacking", "Search", "commonest", "found_by", "lacking", "plan_first", "stalled", "starting_at"]

STUCK = 20  # generations without a better tree
SHOWN = 3  # of the reasons for which a tree fails


@dataclasses.dataclass(frozen=True)
class Search:
    """What to start: settings, and where to begin; `no_plan` says why there is no plan, empty if there is one."""

    gp: GPConfig
    begin: Beginning
    no_plan: str = ""


@dataclasses.dataclass(frozen=True)
class Lacking:
    """What a tree does not achieve in a start that it is tried in, as statements; and why not the first of them."""

    statements: tuple[str, ...]
    reason: str


def plan_first(task: Task, gp: GPConfig) -> Search:
    """Return a search that ends with the plan for a task if that works, and else evolves: from the plan if there is one."""
    try:
        plan = plan_task(task)
    except UserError as error:
        return Search(dataclasses.replace(gp, accept_baseline=False), ANYWHERE, str(error))
    return Search(dataclasses.replace(starting_at(plan, gp), accept_baseline=True), Beginning(plan))


def starting_at(tree: Tree, gp: GPConfig) -> GPConfig:
    """Return settings with which a tree can be the baseline: if it needs genes under Fallbacks, they are allowed."""
    needs = bool(violations(tree, gene_under_fallback=False)) and not violations(tree, gene_under_fallback=True)
    return dataclasses.replace(gp, accept_baseline=False, gene_under_fallback=gp.gene_under_fallback or needs)


def found_by(config: RunConfig | None, tree: Tree | None) -> str:
    """Say what has found the best tree of a run; nothing if the run was taught since it began."""
    if config is None or tree is None or config.phase > 0:
        return ""
    if config.baseline is None:
        return "Evolved without a plan."
    if config.gp.accept_baseline:
        if tree == config.baseline:
            return "Found by planning: nothing had to be evolved."
        return "Planning alone did not do; evolution went on from the plan."
    if tree == config.baseline:
        return "Nothing better was found than the tree that you gave."
    return "Evolved from the tree that you gave."


def stalled(history: Sequence[tuple[int, float, float]]) -> int:
    """Return for how many generations the best tree has been the same; `history` has rows of generation, best and mean."""
    if not history:
        return 0
    last, best, _ = history[-1]
    return last - next(generation for generation, value, _ in history if value >= best)


def lacking(task: Task, physics: Physics, tree: Tree, seed: int) -> Lacking:
    """Run a tree in the first start that an evolution of that seed measures it in, and return what it does not achieve."""
    layouts, fates = sample_episodes(task, seed, layouts=1, draws=1)
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    playback, words = play(semantics, Settler(task, physics), tree, layouts, fates), Words(task)
    missed = [target for target, met in zip(task.targets, playback.misses.met, strict=True) if not met]
    statements = [f"{words.named(target.object)} {words.target(target)}" for target in missed]
    reached = zip(task.subgoals, playback.final.reached[0], strict=True)
    statements += [f"“{subgoal.name}” reached on the way" for subgoal, done in reached if not done]
    return Lacking(tuple(statements), "" if playback.solved else explain_failure(task, playback))


def commonest(result: dict[str, Any]) -> list[str]:
    """Say for which reasons a tested tree fails, the commonest first, and how often."""
    return [f"{one.reason} ({counted(len(one.layouts), 'time')})" for one in failures(result)[:SHOWN]]
