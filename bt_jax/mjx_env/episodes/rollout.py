"""Episodes without a table: every transition of every episode is simulated.

This is the way where chance is continuous, so that no transition comes twice, and for big batches on a GPU. With
deterministic skills it gives what the table gives, more slowly.
"""

from __future__ import annotations

import functools

import jax
import numpy as np
from jaxtyping import Int32

from bt_jax.encoding.arrays import Trees
from bt_jax.mjx_env.episodes.columns import Chances, Columns
from bt_jax.mjx_env.episodes.evaluator import Evaluation, all_layouts, evaluation, in_batches
from bt_jax.mjx_env.episodes.fitness import target_misses
from bt_jax.mjx_env.episodes.rollout_compiled import rollout
from bt_jax.mjx_env.episodes.rollout_host import HostRollout
from bt_jax.mjx_env.episodes.rules import Ending, Tally
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.physics.protocol import CompiledPhysics, Physics
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take

__all__ = ["RolloutEvaluator"]


class RolloutEvaluator:
    """Evaluate populations by simulating every transition of every episode.

    Physics that compiled loops can call run in one (see `rollout_compiled`), others in a loop on the host (`HostRollout`).
    With `on_host` they always do. With `trace`, evaluations say what each leaf has returned.
    """

    def __init__(
        self, semantics: LeafSemantics, physics: Physics, *, batch: int, trace: bool = False, on_host: bool = False
    ) -> None:
        self.semantics, self.batch, self.trace = semantics, batch, trace
        self._columns = Columns(semantics)
        self.num_broken = 0  # episodes whose simulation diverged
        self._rollout = (
            functools.partial(_compiled, semantics, physics, trace)
            if isinstance(physics, CompiledPhysics) and not on_host
            else HostRollout(semantics, physics, trace=trace)
        )

    def __call__(
        self,
        trees: Trees,
        layouts: World,
        which: Int32[np.ndarray, "P K"] | None = None,
        fates: Fates | None = None,
    ) -> Evaluation:
        """Run P trees [P, N] in K layouts each: rows `which` of the layouts (NumPy), or all of them. `fates` (NumPy): one
        for each of the layouts, of which the same one may stand there several times; nothing goes wrong without them."""
        starts = all_layouts(trees, layouts) if which is None else which
        result = in_batches(functools.partial(self._run, layouts, fates), self.batch, trees, starts)
        self.num_broken += int(np.sum(result.ending == Ending.BROKEN))
        return result

    def _run(self, layouts: World, fates: Fates | None, trees: Trees, starts: Int32[np.ndarray, "P K"]) -> Evaluation:
        tree, rows = np.repeat(np.arange(starts.shape[0], dtype=np.int32), starts.shape[1]), starts.reshape(-1)
        chances = self._columns.chances(None if fates is None else fates[rows], rows.size)
        world, tally = self._rollout(trees, tree, take(layouts, rows), chances)
        return evaluation(
            self.semantics.task,
            trees,
            tally,
            misses=target_misses(self.semantics.task, world),
            reached=world.reached,
            shape=starts.shape,
        )


def _compiled(
    semantics: LeafSemantics,
    physics: CompiledPhysics,
    trace: bool,
    trees: Trees,
    tree: Int32[np.ndarray, " E"],
    start: World,
    chances: Chances | None,
) -> tuple[World, Tally]:
    """Return states and tally (NumPy) at the ends of E episodes: trees `tree` from states `start`."""
    return jax.device_get(rollout(semantics, physics.stepper, trace, trees, tree, start, chances))
