"""The folder that a training leaves behind, and reads again to go on or to run its tree.

config.json        task, settings and version     history.csv         one row a generation and run
best_tree.txt      the learnt tree                best_tree.xml       the same for BehaviorTree.CPP and Groot2
best_tree.svg      its drawing                    learning_curve.png  best and mean fitness over the generations
result.json        best of each run, times          solved.png          the solved scene, where there is a renderer
checkpoint.npz     populations, to resume

Where the task was changed on the way, config-0.json, checkpoint-0.npz and best_tree-0.txt are of the first phase, and so on.
"""

from __future__ import annotations

import csv
import dataclasses
import importlib.metadata
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.formats.text import format_tree, one_line, parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.gp.config import GPConfig, Selection
from bt_jax.gp.evolution import Generation, Population, State
from bt_jax.tasks import Task, task_from_dict
from bt_jax.training.settings import Settings

__all__ = ["Checkpoint", "RunConfig", "RunFolder", "package_version"]

FORMAT = 2


def package_version() -> str:
    """Version of this package."""
    return importlib.metadata.version("bt_jax")


@dataclasses.dataclass(frozen=True)
class RunConfig:
    """Everything needed to repeat a run.

    A run has several phases where it went on with another task, baseline or gene pool: this is phase number `phase`, which
    begins at generation `since`.
    """

    task: Task
    gp: GPConfig
    settings: Settings
    baseline: Tree | None = None
    extra_leaves: tuple[Behavior, ...] = ()
    phase: int = 0
    since: int = 0
    version: str = dataclasses.field(default_factory=package_version)

    def to_json(self) -> str:
        data = {
            "format": FORMAT,
            "version": self.version,
            "task": self.task.to_dict(),
            "gp": dataclasses.asdict(self.gp),
            "settings": dataclasses.asdict(self.settings),
            "baseline": None if self.baseline is None else one_line(self.baseline),
            "extra_leaves": list(map(str, self.extra_leaves)),
            "phase": self.phase,
            "since": self.since,
        }
        return json.dumps(data, indent=2) + "\n"


@dataclasses.dataclass(frozen=True)
class Checkpoint:
    """Where a run was: its state, what its tokens stand for, the phase it was in, and the history."""

    state: State
    leaves: tuple[Behavior, ...]
    phase: int
    history: list[Generation]


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """A folder as described at the top of this module."""

    path: Path

    @staticmethod
    def create(path: Path, config: RunConfig) -> RunFolder:
        """A new folder. Raises UserError where something is there already."""
        folder = RunFolder(path)
        folder.start(config)
        return folder

    def start(self, config: RunConfig, *, resume: bool = False) -> None:
        """Writes the configuration. Raises UserError where the folder is in use and the run is not a resumed one."""
        if not resume and self.path.exists() and (not self.path.is_dir() or any(self.path.iterdir())):
            raise UserError(f"{self.path} is not empty; choose another --out, or continue it with --resume {self.path}")
        write_atomic(self.path / "config.json", config.to_json())

    def begin_phase(self, config: RunConfig) -> None:
        """Replaces the configuration by that of the next phase, and keeps what the phase before had come to under other
        names, so that it can be gone back to."""
        for name in ("checkpoint.npz", "best_tree.txt", "config.json"):
            kept = self.path / name
            if kept.is_file():
                write_atomic(kept.with_stem(f"{kept.stem}-{config.phase - 1}"), kept.read_bytes())
        write_atomic(self.path / "config.json", config.to_json())

    def phases(self) -> list[int]:
        """The generations at which phases after the first began."""
        config, found = self.config(), []
        for phase in range(1, config.phase):
            try:
                found.append(int(json.loads((self.path / f"config-{phase}.json").read_text(encoding="utf-8"))["since"]))
            except (OSError, ValueError, KeyError, TypeError):
                continue  # only a line in the figure is lost
        return [*found, config.since] if config.phase else found

    def config(self) -> RunConfig:
        """Reads the configuration. Raises UserError where this is no run folder, or one of another version."""
        source = self.path / "config.json"
        if not source.is_file():
            raise UserError(
                f"{self.path} is not a run folder, it has no config.json; give a folder that train has written"
            )
        try:
            data = json.loads(source.read_text(encoding="utf-8"))
            found = data["format"]
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise UserError(f"{source} cannot be read; restore it, or train again") from error
        if found != FORMAT:
            raise UserError(
                f"{self.path} has format {found} and this version reads {FORMAT}; use the version that wrote it"
            )
        try:
            methods = {key: Selection(data["gp"][key]) for key in ("parent_selection", "survivor_selection")}
            gp, settings = GPConfig(**{**data["gp"], **methods}), Settings(**data["settings"])
            baseline = None if data["baseline"] is None else parse_tree(data["baseline"])
            extra = tuple(_leaf(text) for text in data["extra_leaves"])
            phase, since, version = int(data["phase"]), int(data["since"]), data["version"]
        except (TypeError, KeyError, ValueError, UserError) as error:
            raise UserError(f"{source} is damaged ({error}); restore it, or train again") from error
        task = task_from_dict(data["task"], source=str(source))
        return RunConfig(task, gp, settings, baseline, extra, phase, since, version)

    def tree(self) -> Tree:
        """The learnt tree."""
        source = self.path / "best_tree.txt"
        if not source.is_file():
            raise UserError(
                f"{self.path} holds no tree yet; finish it with python -m bt_jax.train --resume {self.path}"
            )
        return parse_tree(source.read_text(encoding="utf-8"))

    def save_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Replaces the checkpoint; a killed process leaves the previous one."""
        buffer, state = io.BytesIO(), checkpoint.state
        niche = state.population.niche
        np.savez(
            buffer,
            tokens=np.asarray(state.population.trees.tokens),
            sizes=np.asarray(state.population.trees.sizes),
            fitness=np.asarray(state.population.fitness),
            **({} if niche is None else {"niche": np.asarray(niche)}),
            baseline_fitness=np.asarray(state.baseline_fitness),
            seen=np.concatenate(state.seen),
            counts=np.array([len(hashes) for hashes in state.seen]),
            earlier=np.array(state.earlier),
            generation=np.array(state.generation),
            phase=np.array(checkpoint.phase),
            leaves=_as_bytes("\n".join(map(str, checkpoint.leaves))),
            history=_as_bytes(history_csv(checkpoint.history)),
        )
        write_atomic(self.path / "checkpoint.npz", buffer.getvalue())

    def load_checkpoint(self) -> Checkpoint | None:
        """The last checkpoint, or None where the run had not come to one."""
        source = self.path / "checkpoint.npz"
        if not source.is_file():
            return None
        try:
            with np.load(source) as data:
                trees = Trees(jnp.asarray(data["tokens"]), jnp.asarray(data["sizes"]))
                niche = jnp.asarray(data["niche"]) if "niche" in data else None
                state = State(
                    population=Population(trees, jnp.asarray(data["fitness"]), niche),
                    generation=int(data["generation"]),
                    baseline_fitness=jnp.asarray(data["baseline_fitness"]),
                    seen=tuple(np.split(data["seen"], np.cumsum(data["counts"])[:-1])),
                    earlier=tuple(data["earlier"].tolist()),
                )
                leaves = tuple(map(_leaf, data["leaves"].tobytes().decode().splitlines()))
                history = read_history(data["history"].tobytes().decode())
                return Checkpoint(state, leaves, int(data["phase"]), history)
        except (ValueError, KeyError, OSError, EOFError, zipfile.BadZipFile) as error:
            raise UserError(f"{source} is damaged; delete it to start this run again") from error

    def save_tree(self, tree: Tree, *, title: str, name: str = "best_tree") -> None:
        """Text, XML and drawing of a tree: of the learnt one, or of one that is kept beside it under another name."""
        write_atomic(self.path / f"{name}.txt", format_tree(tree))
        write_atomic(self.path / f"{name}.xml", to_xml(tree))
        write_atomic(self.path / f"{name}.svg", to_svg(tree, title=title))

    def save_history(self, history: list[Generation]) -> None:
        write_atomic(self.path / "history.csv", history_csv(history))

    def save_picture(self, name: str, png: bytes) -> None:
        write_atomic(self.path / name, png)

    def save_result(self, result: dict[str, Any]) -> None:
        write_atomic(self.path / "result.json", json.dumps(result, indent=2) + "\n")


def _leaf(text: str) -> Behavior:
    leaf = parse_tree(text)
    if not isinstance(leaf, Behavior):
        raise ValueError(f"{text} is not a leaf")
    return leaf


def _as_bytes(text: str) -> np.ndarray:
    return np.frombuffer(text.encode(), np.uint8)


def history_csv(history: list[Generation]) -> str:
    """One row for each generation and run; fitness with 4 digits after the point."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(field.name for field in dataclasses.fields(Generation))
    for row in history:
        writer.writerow(f"{x:.4f}" if isinstance(x, float) else x for x in dataclasses.astuple(row))
    return out.getvalue()


def read_history(text: str) -> list[Generation]:
    """Reads what `history_csv` writes."""
    kinds = {field.name: {"int": int, "float": float}[str(field.type)] for field in dataclasses.fields(Generation)}
    rows = csv.DictReader(io.StringIO(text))
    return [Generation(**{name: kinds[name](value) for name, value in row.items()}) for row in rows]
