"""What runs of the search for achievements have learnt, as arrays of a checkpoint."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int16, Int32, Int64, UInt8, UInt64

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.archive import Archive
from bt_jax.gp.achievements.knowledge import Knowledge
from bt_jax.gp.achievements.linkage import Linkage

__all__ = ["KNOWLEDGE", "arrays_of", "knowledge_of"]

KNOWLEDGE: Mapping[str, Any] = types.MappingProxyType(
    {
        "kept_tokens": Int16[np.ndarray, "E N"],  # the archives of all runs, one after the other
        "kept_sizes": UInt8[np.ndarray, "E N"],
        "kept_fitness": Float32[np.ndarray, " E"],
        "kept_keys": UInt64[np.ndarray, " E"],
        "kept_missed": Float32[np.ndarray, "E A"],  # not in older files
        "kept_counts": Int64[np.ndarray, " R"],
        "tested": Int32[np.ndarray, "R V"],
        "achieves": Float32[np.ndarray, "R V A"],
        "pairs": Float32[np.ndarray, "R V V"],
        "order": Float32[np.ndarray, "R V V"],
        "solved": Bool[np.ndarray, " R"],
        "stagnant": Int64[np.ndarray, " R"],
    }
)


def arrays_of(knowledge: tuple[Knowledge, ...]) -> dict[str, np.ndarray]:
    """Return the arrays for what R runs have learnt; none if they learn nothing."""
    if not knowledge:
        return {}
    archives, linkages = [known.archive for known in knowledge], [known.linkage for known in knowledge]
    return {
        "kept_tokens": np.concatenate([archive.trees.tokens for archive in archives]),
        "kept_sizes": np.concatenate([archive.trees.sizes for archive in archives]),
        "kept_fitness": np.concatenate([archive.fitness for archive in archives]),
        "kept_keys": np.concatenate([archive.keys for archive in archives]),
        "kept_missed": np.concatenate([archive.missed for archive in archives]),
        "kept_counts": np.array([len(archive) for archive in archives]),
        "tested": np.stack([linkage.tested for linkage in linkages]),
        "achieves": np.stack([linkage.achieves for linkage in linkages]),
        "pairs": np.stack([linkage.pairs for linkage in linkages]),
        "order": np.stack([linkage.order for linkage in linkages]),
        "solved": np.array([known.solved for known in knowledge]),
        "stagnant": np.array([known.stagnant for known in knowledge]),
    }


def knowledge_of(arrays: Mapping[str, np.ndarray]) -> tuple[Knowledge, ...]:
    """Return what the arrays of a checkpoint say, which are of the shapes of `KNOWLEDGE`."""
    if "kept_counts" not in arrays:
        return ()
    if "kept_missed" not in arrays:
        missed = np.zeros((len(arrays["kept_keys"]), arrays["achieves"].shape[-1]), np.float32)
        arrays = {**arrays, "kept_missed": missed}
    ends = np.cumsum(arrays["kept_counts"])[:-1]
    kept = {name: np.split(arrays[f"kept_{name}"], ends) for name in ("tokens", "sizes", "fitness", "keys", "missed")}
    return tuple(
        Knowledge(
            Archive(
                Trees(kept["tokens"][run], kept["sizes"][run]),
                *(kept[name][run] for name in ("fitness", "keys", "missed")),
            ),
            Linkage(*(arrays[name][run] for name in ("tested", "achieves", "pairs", "order"))),
            bool(arrays["solved"][run]),
            int(arrays["stagnant"][run]),
        )
        for run in range(len(arrays["kept_counts"]))
    )
