"""The state of a run as a file, from which it continues exactly as if it had never stopped."""

from __future__ import annotations

import dataclasses
import io
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import UInt8

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.behaviors import Behavior
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.evolution import Generation, Population, State
from bt_jax.training.history import history_csv, read_history
from bt_jax.training.run_config import parse_leaf

__all__ = ["Checkpoint"]


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """The state of a run, the leaves that its tokens stand for, the phase it is in, and its history so far."""

    state: State
    leaves: tuple[Behavior, ...]
    phase: int
    history: list[Generation]

    def save(self, path: Path) -> None:
        """Replace the file; a process that is killed meanwhile leaves the previous one."""
        buffer, state = io.BytesIO(), self.state
        niche = state.population.niche
        arrays: dict[str, Any] = {} if niche is None else {"niche": np.asarray(niche)}
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
            leaves=_as_bytes("\n".join(map(str, self.leaves))),
            history=_as_bytes(history_csv(self.history)),
        )
        write_atomic(path, buffer.getvalue())

    @staticmethod
    def load(path: Path) -> Checkpoint | None:
        """Return what was saved, None if nothing was. Raise UserError if the file is damaged."""
        if not path.is_file():
            return None
        try:
            with np.load(path) as data:
                trees = Trees(jnp.asarray(data["tokens"]), jnp.asarray(data["sizes"]))
                niche = jnp.asarray(data["niche"]) if "niche" in data else None
                state = State(
                    population=Population(trees, jnp.asarray(data["fitness"]), niche),
                    generation=int(data["generation"]),
                    baseline_fitness=jnp.asarray(data["baseline_fitness"]),
                    seen=tuple(np.split(data["seen"], np.cumsum(data["counts"])[:-1])),
                    earlier=tuple(data["earlier"].tolist()),
                )
                leaves = tuple(map(parse_leaf, data["leaves"].tobytes().decode().splitlines()))
                history = read_history(data["history"].tobytes().decode())
                return Checkpoint(state, leaves, int(data["phase"]), history)
        except Exception as error:  # a damaged file may raise almost anything in zipfile and NumPy
            raise UserError(f"{path} is damaged; delete it to start this run again") from error


def _as_bytes(text: str) -> UInt8[np.ndarray, " n"]:
    return np.frombuffer(text.encode(), np.uint8)
