"""The folder that a training leaves behind, and reads again to go on or to run its tree.

config.json        task, settings and version       history.csv         one row a generation and run
best_tree.txt      the learnt tree                  best_tree.xml       the same for BehaviorTree.CPP and Groot2
best_tree.svg      its drawing                      learning_curve.png  best and mean fitness over the generations
result.json        best of each run, times          final_scene.png     the scene after an episode
checkpoint.npz     populations, to resume           note.json           a name and a note, if a person has given any

`episodes` means the same in history.csv, result.json and progress.json: the episodes that the fitness of the distinct trees
took so far, one for each of `trees_measured` trees in each of the K layouts of its run. In history.csv and result.json they
are of each run, in progress.json of all runs together. A result.json without `trees_measured` is older and has the number of
trees as `episodes`.

The picture of the scene is missing if there is no renderer, and was called solved.png before.
`run --simplify` adds simplified_tree.*, in the formats of best_tree.*, whose simpler form it is.

If the task was changed on the way, config-0.json, checkpoint-0.npz and best_tree-0.txt are of the first phase, and so on.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.text_files import read_text
from bt_jax.behaviors import Tree
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import format_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.gp.evolution import Generation
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.history import history_csv, read_history
from bt_jax.training.run_config import RunConfig

__all__ = ["RunFolder", "not_of_one_run"]


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """A folder as described at the top of this module."""

    path: Path

    @staticmethod
    def create(path: Path, config: RunConfig) -> RunFolder:
        """Make a new folder. Raise UserError if something is there already."""
        folder = RunFolder(path)
        folder.start(config)
        return folder

    @property
    def is_free(self) -> bool:
        """Whether a run can begin here: there is nothing of that name, or an empty folder."""
        return not self.path.exists() or (self.path.is_dir() and not any(self.path.iterdir()))

    def start(self, config: RunConfig) -> None:
        """Write the configuration. Raise UserError if something is in the folder already."""
        if not self.is_free:
            raise UserError(f"{self.path} is not empty; choose another folder")
        self.save_config(config)

    def begin_again(self, config: RunConfig) -> None:
        """Replace the configuration by that of a run that goes on. At a new phase, what the one before has reached is
        kept under other names, so that one can go back to it."""
        if self.config().phase < config.phase:
            for name in ("checkpoint.npz", "best_tree.txt", "config.json"):
                kept = self.path / name
                if kept.is_file():
                    write_atomic(kept.with_stem(f"{kept.stem}-{config.phase - 1}"), kept.read_bytes())
        self.save_config(config)

    def phases(self) -> list[int]:
        """Return the generations at which phases after the first began."""
        config = self.config()
        names = (path.stem.removeprefix("config-") for path in self.path.glob("config-*.json"))
        numbers = sorted(int(name) for name in names if name.isdecimal() and 0 < int(name) < config.phase)
        earlier = [self._config_of(number) for number in numbers]
        return [one.since for one in (*earlier, config) if one is not None and one.phase]

    def config(self) -> RunConfig:
        """Return the configuration. Raise UserError if this is not a run folder, or one of another version."""
        source = self.path / "config.json"
        if not source.is_file():
            raise UserError(
                f"{self.path} is not a run folder, it has no config.json; give a folder that train has written"
            )
        return RunConfig.read(source)

    def _config_of(self, phase: int) -> RunConfig | None:
        """Return the configuration of a phase, None if that of an earlier one is missing or damaged."""
        config = self.config()
        if phase == config.phase:
            return config
        with contextlib.suppress(UserError):
            return RunConfig.read(self.path / f"config-{phase}.json")
        return None

    def tree(self) -> Tree:
        """Return the learnt tree. Raise UserError if the run has none yet."""
        source = self.path / "best_tree.txt"
        if not source.is_file():
            raise UserError(
                f"{self.path} holds no tree yet; finish it with python -m bt_jax.train --resume "
                f"{shlex.quote(str(self.path))}",
                code="no tree yet",
                run=self.path.name,
            )
        return read_tree(source)

    def history(self) -> list[Generation]:
        """Return what `history.csv` holds. Raise UserError, naming it, if it is missing or damaged."""
        source = self.path / "history.csv"
        try:
            return read_history(read_text(source))
        except UserError as error:
            raise UserError(str(error) if str(source) in str(error) else f"{source}: {error}") from error

    def load_checkpoint(self) -> Checkpoint | None:
        """Return the last checkpoint, None if the run has none yet. Raise UserError if it is damaged, or is not of this
        run."""
        phase = self.config().phase
        checkpoint = Checkpoint.load(self.path / "checkpoint.npz", remedy="delete it to start this run again")
        if checkpoint is None:
            return None
        problem, config = "", self._config_of(checkpoint.phase)
        if checkpoint.phase > phase:
            problem = f"the checkpoint is of phase {checkpoint.phase} and the configuration of phase {phase}"
        elif config is not None:
            problem = _contradiction(checkpoint, config)
        if problem:
            raise not_of_one_run(self.path, problem)
        return checkpoint

    def save_checkpoint(self, checkpoint: Checkpoint) -> None:
        """Replace the checkpoint."""
        checkpoint.save(self.path / "checkpoint.npz")

    def save_config(self, config: RunConfig) -> None:
        """Write `config.json`."""
        write_atomic(self.path / "config.json", config.to_json())

    def save_tree(self, tree: Tree, *, title: str) -> None:
        """Write text, XML and drawing of the learnt tree, and remove a simplified tree that was made from another."""
        before = self.path / "best_tree.txt"
        if not before.is_file() or before.read_bytes() != format_tree(tree).encode():
            for stale in self.path.glob("simplified_tree.*"):
                stale.unlink()
        self._write_tree("best_tree", tree, title)

    def save_simplified(self, tree: Tree, *, title: str) -> list[Path]:
        """Write text, XML and drawing of the simplified tree beside the learnt one, and return their paths."""
        return self._write_tree("simplified_tree", tree, title)

    def _write_tree(self, name: str, tree: Tree, title: str) -> list[Path]:
        texts = {"txt": format_tree(tree), "xml": to_xml(tree), "svg": to_svg(tree, title=title)}
        for suffix, text in texts.items():
            write_atomic(self.path / f"{name}.{suffix}", text)
        return [self.path / f"{name}.{suffix}" for suffix in texts]

    def save_history(self, history: Sequence[Generation]) -> None:
        """Write `history.csv`."""
        write_atomic(self.path / "history.csv", history_csv(history))

    def save_result(self, result: dict[str, Any]) -> None:
        """Write `result.json`."""
        write_atomic(self.path / "result.json", json.dumps(result, indent=2) + "\n")

    def save_picture(self, name: str, png: bytes) -> None:
        """Write a picture."""
        write_atomic(self.path / name, png)


def not_of_one_run(folder: Path, problem: str) -> UserError:
    """Return the error about a checkpoint and a configuration that contradict each other."""
    return UserError(
        f"{folder / 'checkpoint.npz'} and {folder / 'config.json'} are not of one run: {problem}; restore the one that was "
        "changed, or delete the checkpoint to start this run again"
    )


def _contradiction(checkpoint: Checkpoint, config: RunConfig) -> str:
    """Say what differs between a checkpoint and the configuration of its phase, with an empty text if nothing does."""
    runs, population, nodes = checkpoint.state.population.trees.tokens.shape
    found: dict[str, Any] = {"runs": runs, "population": population, "max_nodes": nodes}
    said = {name: getattr(config.gp, name) for name in found}
    if (kept := checkpoint.config) is not None:
        found |= _as_data(kept)
        said |= _as_data(config)
    different = next((name for name in found if found[name] != said[name]), None)
    if different is None:
        return ""
    if different in ("task", "baseline", "extra_leaves"):
        return f"{different} differs"
    return f"the checkpoint says {different} {found[different]} and the configuration {said[different]}"


def _as_data(config: RunConfig) -> dict[str, Any]:
    """Return what stays the same within a phase."""
    fixed = {name: getattr(config, name) for name in ("task", "baseline", "extra_leaves", "x64")}
    gp = {**dataclasses.asdict(config.gp), "generations": None, "patience": None}
    return {**gp, **dataclasses.asdict(config.settings), **fixed}
