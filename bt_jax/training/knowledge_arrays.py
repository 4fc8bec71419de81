"""What runs of the search for achievements have learnt, as arrays of a checkpoint."""

from __future__ import annotations

import types
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int16, Int32, Int64, UInt8, UInt64

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.archive import Archive
from bt_jax.gp.achievements.knowledge import Knowledge
from bt_jax.gp.achievements.linkage import Linkage
from bt_jax.gp.achievements.pairs import Pairs

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
        "failed": Int32[np.ndarray, "R V"],  # not in older files
        "achieves": Float32[np.ndarray, "R V A"],
        "pair_keys": Int32[np.ndarray, " K"],  # the pairs of all runs, one after the other
        "pair_stood": Float32[np.ndarray, " K"],
        "pair_worked": Float32[np.ndarray, " K"],
        "pair_counts": Int64[np.ndarray, " R"],
        "pairs": Float32[np.ndarray, "R V V"],  # in older files, in place of these: `stood` of each pair
        "order": Float32[np.ndarray, "R V V"],  # and `worked`
        "solved": Bool[np.ndarray, " R"],
        "stagnant": Int64[np.ndarray, " R"],
        "success": Float64[np.ndarray, " R"],  # not in older files
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
        "failed": np.stack([linkage.failed for linkage in linkages]),
        "achieves": np.stack([linkage.achieves for linkage in linkages]),
        "pair_keys": np.concatenate([linkage.pairs.keys for linkage in linkages]),
        "pair_stood": np.concatenate([linkage.pairs.stood for linkage in linkages]),
        "pair_worked": np.concatenate([linkage.pairs.worked for linkage in linkages]),
        "pair_counts": np.array([len(linkage.pairs.keys) for linkage in linkages]),
        "solved": np.array([known.solved for known in knowledge]),
        "stagnant": np.array([known.stagnant for known in knowledge]),
        "success": np.array([known.success for known in knowledge], np.float64),
    }


def knowledge_of(arrays: Mapping[str, np.ndarray]) -> tuple[Knowledge, ...]:
    """Return what the arrays of a checkpoint say, which are of the shapes of `KNOWLEDGE`."""
    if "kept_counts" not in arrays:
        return ()
    if "kept_missed" not in arrays:
        missed = np.zeros((len(arrays["kept_keys"]), arrays["achieves"].shape[-1]), np.float32)
        arrays = {**arrays, "kept_missed": missed}
    arrays = {"failed": np.zeros_like(arrays["tested"]), "success": arrays["solved"].astype(np.float64), **arrays}
    kept = _split(arrays, "kept", ("tokens", "sizes", "fitness", "keys", "missed"))
    pairs = _pairs(arrays)
    return tuple(
        Knowledge(
            Archive(
                Trees(kept["tokens"][run], kept["sizes"][run]),
                *(kept[name][run] for name in ("fitness", "keys", "missed")),
            ),
            Linkage(arrays["tested"][run], arrays["achieves"][run], pairs[run], arrays["failed"][run]),
            bool(arrays["solved"][run]),
            int(arrays["stagnant"][run]),
            float(arrays["success"][run]),
        )
        for run in range(len(arrays["kept_counts"]))
    )


def _pairs(arrays: Mapping[str, np.ndarray]) -> list[Pairs]:
    """Return the counts of pairs of each run."""
    if "pair_counts" in arrays:
        found = _split(arrays, "pair", ("keys", "stood", "worked"))
        return [Pairs(*fields) for fields in zip(*found.values(), strict=True)]
    pairs = []
    for stood, worked in zip(arrays["pairs"], arrays["order"], strict=True):
        first, second = np.nonzero(stood)
        pairs.append(Pairs.empty().with_(first, second, stood[first, second], worked[first, second]))
    return pairs


def _split(arrays: Mapping[str, np.ndarray], kind: str, names: tuple[str, ...]) -> dict[str, list[np.ndarray]]:
    """Return the arrays of a kind, each split into the parts of the runs."""
    ends = np.cumsum(arrays[f"{kind}_counts"])[:-1]
    return {name: np.split(arrays[f"{kind}_{name}"], ends) for name in names}
