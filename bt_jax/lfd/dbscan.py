"""Density-based clustering of a few points.

Ester et al., A density-based algorithm for discovering clusters in large spatial databases with noise (1996). Labels are
those of scikit-learn's `DBSCAN`, which takes longer to import than everything else that this package needs together.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

__all__ = ["dbscan"]


def dbscan(points: Float[np.ndarray, "n d"], eps: float, min_samples: int) -> Int[np.ndarray, " n"]:
    """Return the cluster of each point, -1 for noise.

    A point is core if at least `min_samples` points, itself included, lie within `eps`. Clusters are numbered by their first
    core point; a border point joins the first cluster that reaches it. Takes memory quadratic in the number of points.
    """
    near = ((points[:, None] - points) ** 2).sum(axis=-1) <= eps**2
    core = near.sum(axis=1) >= min_samples
    labels, label = np.full(len(points), -1), 0
    for seed in np.flatnonzero(core):
        if labels[seed] >= 0:
            continue
        cluster, grown = np.zeros_like(core), near[seed]
        while (grown & ~cluster).any():
            cluster = grown
            grown = near[cluster & core].any(axis=0)
        labels[cluster & (labels < 0)] = label
        label += 1
    return labels
