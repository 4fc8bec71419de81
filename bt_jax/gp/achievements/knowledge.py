"""What one run has learnt, and how episodes add to it."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Int8, Int32

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.archive import Archive, keys_of
from bt_jax.gp.achievements.goals import Goals, Measured
from bt_jax.gp.achievements.linkage import Linkage
from bt_jax.gp.achievements.traces import without_idle

__all__ = ["Knowledge"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Knowledge:
    """The archive and the counts of one run; whether its fittest tree solves the task, for how many generations none was
    fitter, and which share of the episodes it solves."""

    archive: Archive
    linkage: Linkage
    solved: bool = False
    stagnant: int = 0
    success: float = 0.0

    @staticmethod
    def empty(goals: Goals, num_nodes: int, baseline: Trees | None = None) -> Knowledge:
        """Return what is known before the first episode, of a baseline [N] only what it is made of."""
        return Knowledge(Archive.empty(num_nodes, len(goals.concerns)), Linkage.empty(goals, baseline))

    def done(self) -> Bool[np.ndarray, " A"]:
        """Return which achievements a tree of the archive has."""
        return np.asarray(self.archive.achieved(self.linkage.achieves.shape[1]).any(axis=0))

    def missing_steps(self, goals: Goals) -> Int32[np.ndarray, " _"]:
        """Return the steps on the way that no tree has done and that a guard tells of."""
        return np.flatnonzero((goals.guard > 0) & ~self.done()).astype(np.int32)

    def out_of_reach(self, goals: Goals) -> Int32[np.ndarray, " _"]:
        """Return the achievements of groups that no tree has had in any layout, though every leaf of the group was tested.
        One that a leaf of the baseline is expected to bring about is not among them."""
        tested = [bool((self.linkage.tested[goals.group == group] > 0).all()) for group in goals.concerns]
        had = self.done() | (self.linkage.achieves.max(axis=0, initial=0) > 0)
        return np.flatnonzero(np.array(tested, bool) & (goals.concerns >= 0) & ~had).astype(np.int32)

    def summary(self) -> dict[str, int | float]:
        """Return the figures of the knowledge that `Generation` has."""
        most = int(np.bitwise_count(self.archive.keys).max(initial=0))
        understood = int((self.done() | self.linkage.known()).sum())
        return {"kept": len(self.archive), "achieved": most, "understood": understood, "success": self.success}

    def updated(
        self,
        trees: Trees,
        measured: Measured,
        goals: Goals,
        kinds: Int8[np.ndarray, " V"],
        *,
        gene_under_fallback: bool,
    ) -> Knowledge:
        """Return the knowledge after a generation of M trees [M, N] (NumPy). The archive gets them without the nodes that
        did nothing."""
        keys = keys_of(measured.achieved >= goals.often)
        rows = self.archive.entrants(measured.fitness, keys, drift=not self.solved)
        linkage = self.linkage.updated(trees, measured, goals)
        if not rows.size:
            return dataclasses.replace(self, linkage=linkage, stagnant=self.stagnant + 1)
        smaller = [
            without_idle(trees[row], measured.trace[row], kinds, gene_under_fallback=gene_under_fallback)
            for row in rows
        ]
        entering = Trees(np.stack([tree.tokens for tree in smaller]), np.stack([tree.sizes for tree in smaller]))
        removed = trees.sizes[rows, 0].astype(np.float32) - entering.sizes[:, 0]
        fitness = measured.fitness[rows] + np.float32(goals.node_cost) * removed
        best = int(fitness.argmax())
        better = fitness[best] > self.archive.fitness.max(initial=-np.inf)
        success = float(measured.solved[rows[best]]) if better else self.success
        return Knowledge(
            self.archive.with_(Archive(entering, fitness, keys[rows], measured.missed[rows])),
            linkage,
            solved=success >= goals.often if better else self.solved,
            stagnant=0 if better else self.stagnant + 1,
            success=success,
        )

    def settled(self, tree: Trees, measured: Measured, goals: Goals, *, stagnant: int) -> Knowledge:
        """Return the knowledge of a run that needs no more than one tree [1, N]: it is the only one in the archive, whole,
        and as if nothing had improved on it for `stagnant` generations."""
        archive = Archive(tree, measured.fitness, keys_of(measured.achieved >= goals.often), measured.missed)
        success = float(measured.solved[0])
        return dataclasses.replace(self, archive=archive, solved=True, stagnant=stagnant, success=success)

    def complete(self, goals: Goals) -> Int32[np.ndarray, " _"]:
        """Return the entries of the archive that have all achievements that concern a group, the fittest first."""
        has_all = self.archive.achieved(len(goals.concerns))[:, goals.concerns >= 0].all(axis=1)
        rows = np.flatnonzero(has_all).astype(np.int32)
        return rows[np.argsort(-self.archive.fitness[rows], kind="stable")]

    def tried(self, rows: Int32[np.ndarray, " K"], measured: Measured, goals: Goals) -> Knowledge:
        """Return the knowledge after entries of the archive were tried in more layouts: those that do not solve them all are
        from now on worth what they are worth there. Where episodes differ by chance, see `_compared`."""
        if goals.often < 1:
            return self._compared(rows, measured, goals)
        failed = measured.solved < 1
        if not failed.any():
            return self
        worse = Archive(
            self.archive.trees[rows[failed]],
            measured.fitness[failed],
            keys_of(measured.achieved[failed] >= 1),
            measured.missed[failed],
        )
        archive = self.archive.at(np.setdiff1d(np.arange(len(self.archive)), rows[failed])).with_(worse)
        known = dataclasses.replace(self, archive=archive)
        solved = archive.fitness.argmax() in known.complete(goals)
        passed = solved and not failed.all()
        return dataclasses.replace(known, solved=solved, stagnant=self.stagnant if passed else 0)

    def _compared(self, rows: Int32[np.ndarray, " K"], measured: Measured, goals: Goals) -> Knowledge:
        """Return the knowledge after entries of the archive, the fittest among them, were compared in more episodes: their
        ranking there counts from now on, since the fittest in few episodes is the one that was lucky in them. Their mean
        fitness stays, so that other trees, which have seen none of the new episodes, compare as before."""
        fitness = self.archive.fitness.copy()
        fitness[rows] = measured.fitness + (fitness[rows].mean() - measured.fitness.mean())
        archive = dataclasses.replace(self.archive, fitness=fitness)
        best = int(fitness.argmax())
        if best not in rows:
            return dataclasses.replace(self, archive=archive, stagnant=0)
        success = float(measured.solved[np.flatnonzero(rows == best)[0]])
        solved = success >= goals.often
        return dataclasses.replace(
            self, archive=archive, solved=solved, stagnant=self.stagnant if solved else 0, success=success
        )
