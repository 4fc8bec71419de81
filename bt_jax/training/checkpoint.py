"""The state of a run as a file, from which it continues exactly as if it had never stopped."""

from __future__ import annotations

import dataclasses
import io
import json
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int16, Int32, Int64, UInt8, UInt64, jaxtyped

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.text_files import read_bytes
from bt_jax.behaviors import FIRST_LEAF, Behavior, Decorator, Kind
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.evolution import Generation, Population, State
from bt_jax.training.history import history_csv, read_history
from bt_jax.training.knowledge_arrays import KNOWLEDGE, arrays_of, knowledge_of
from bt_jax.training.run_config import RunConfig, parse_leaf

__all__ = ["Checkpoint"]


ARRAYS: Mapping[str, Any] = types.MappingProxyType(
    {
        "tokens": Int16[np.ndarray, "R P N"],
        "sizes": UInt8[np.ndarray, "R P N"],
        "fitness": Float32[np.ndarray, "R P"],
        "niche": Int32[np.ndarray, "R P"],  # only with niches
        "baseline_fitness": Float32[np.ndarray, " R"],
        "seen": UInt64[np.ndarray, " hashes"],
        "counts": Int64[np.ndarray, " R"],
        "earlier": Int64[np.ndarray, " R"],
        "generation": Int64[np.ndarray, ""],
        "phase": Int64[np.ndarray, ""],
        "leaves": UInt8[np.ndarray, " leaf_bytes"],
        "decorators": Int64[np.ndarray, "decorators 2"],  # kind and number of each, only if there are any
        "history": UInt8[np.ndarray, " history_bytes"],
        "config": UInt8[np.ndarray, " config_bytes"],  # not in older files
        **KNOWLEDGE,  # only of the method achievements
    }
)


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """The state of a run, the leaves and decorators that its tokens stand for, the phase it is in, and its history so
    far."""

    state: State
    symbols: tuple[Behavior | Decorator, ...]
    phase: int
    history: list[Generation]
    config: RunConfig | None = None  # of the run; older files do not say

    def save(self, path: Path) -> None:
        """Replace the file; a process that is killed meanwhile leaves the previous one."""
        buffer, state = io.BytesIO(), self.state
        niche = state.population.niche
        arrays: dict[str, Any] = {} if niche is None else {"niche": np.asarray(niche)}
        arrays |= arrays_of(state.knowledge)
        leaves = [symbol for symbol in self.symbols if isinstance(symbol, Behavior)]
        counting = [symbol for symbol in self.symbols if isinstance(symbol, Decorator)]
        if counting:
            arrays["decorators"] = np.array([(one.kind, one.number) for one in counting], np.int64)
        if self.config is not None:
            arrays["config"] = _as_bytes(self.config.to_json())
        np.savez(
            buffer,
            tokens=np.asarray(state.population.trees.tokens),
            sizes=np.asarray(state.population.trees.sizes),
            fitness=np.asarray(state.population.fitness),
            **arrays,
            baseline_fitness=np.asarray(state.baseline_fitness),
            seen=np.concatenate(state.seen),
            counts=np.array([len(hashes) for hashes in state.seen]),
            earlier=np.array(state.earlier),
            generation=np.array(state.generation),
            phase=np.array(self.phase),
            leaves=_as_bytes("\n".join(map(str, leaves))),
            history=_as_bytes(history_csv(self.history)),
        )
        write_atomic(path, buffer.getvalue())

    @staticmethod
    def load(path: Path, *, remedy: str = "give one that train has written") -> Checkpoint | None:
        """Return what was saved, None if nothing was. Raise UserError, with the remedy, if the file is damaged or was not
        written by train."""
        if not path.exists():
            return None
        data = read_bytes(path)
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                if not set(arrays).intersection(ARRAYS):
                    raise UserError(f"{path} is no checkpoint of train; {remedy}")
                return _checkpoint(arrays, path)
        except MemoryError as error:
            raise UserError(f"{path} needs more memory than there is; close other programs, or {remedy}") from error
        except Exception as error:  # a damaged file may raise almost anything in zipfile and NumPy
            if isinstance(error, UserError) and str(path) in str(error):
                raise
            raise UserError(f"{path} is damaged; {remedy}") from error


def _checkpoint(arrays: Mapping[str, np.ndarray], path: Path) -> Checkpoint:
    """Return what the arrays of a file say. Raise ValueError or the like if they contradict each other."""
    with jaxtyped("context"):  # the same letter is the same number everywhere
        wrong = [name for name, kind in ARRAYS.items() if name in arrays and not isinstance(arrays[name], kind)]
    if wrong:
        raise ValueError(f"{', '.join(wrong)} have other types or shapes than they should")
    counting = arrays["decorators"].tolist() if "decorators" in arrays else []
    symbols: tuple[Behavior | Decorator, ...] = (
        *map(parse_leaf, _as_text(arrays["leaves"]).splitlines()),
        *(Decorator(Kind(kind), number) for kind, number in counting),
    )
    trees = Trees(jnp.asarray(arrays["tokens"]), jnp.asarray(arrays["sizes"]))
    for kind in ("", "kept_"):
        if f"{kind}tokens" not in arrays:
            continue
        if not _are_trees(arrays[f"{kind}tokens"], arrays[f"{kind}sizes"], FIRST_LEAF + len(symbols)):
            raise ValueError(f"{kind}tokens and {kind}sizes are no trees of these leaves")
    if "tested" in arrays and arrays["tested"].shape[1] != FIRST_LEAF + len(symbols):
        raise ValueError("the counts are of other leaves")
    state = State(
        population=Population(
            trees, jnp.asarray(arrays["fitness"]), jnp.asarray(arrays["niche"]) if "niche" in arrays else None
        ),
        generation=int(arrays["generation"]),
        baseline_fitness=jnp.asarray(arrays["baseline_fitness"]),
        seen=tuple(np.split(arrays["seen"], np.cumsum(arrays["counts"])[:-1])),
        earlier=tuple(arrays["earlier"].tolist()),
        knowledge=knowledge_of(arrays),
    )
    history = read_history(_as_text(arrays["history"]))
    if history and history[-1].generation != state.generation:
        raise ValueError("the history ends at another generation")
    config = RunConfig.of(json.loads(_as_text(arrays["config"])), path) if "config" in arrays else None
    return Checkpoint(state, symbols, int(arrays["phase"]), history, config)


def _are_trees(tokens: Int16[np.ndarray, "*P N"], sizes: UInt8[np.ndarray, "*P N"], vocabulary: int) -> bool:
    """Return whether every node within the length of its tree has a token, and its subtree ends within the tree."""
    lengths, places = sizes[..., :1].astype(int), np.arange(tokens.shape[-1])
    inside = places < lengths
    good = (tokens > 0) & (tokens < vocabulary) & (sizes > 0) & (places + sizes <= lengths)
    return bool((lengths > 0).all() and (lengths <= len(places)).all() and good[inside].all())


def _as_bytes(text: str) -> UInt8[np.ndarray, " n"]:
    return np.frombuffer(text.encode(), np.uint8)


def _as_text(data: UInt8[np.ndarray, " n"]) -> str:
    return data.tobytes().decode()
