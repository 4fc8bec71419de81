"""The evolution that the page shows: a process of its own, `bt_jax.train`, which outlives the page and is found again.

Nothing here waits: orders are signals or lines on a pipe, and `poll` looks at what the process has written.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
import signal
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from bt_jax._util.errors import UserError
from bt_jax._util.files import unused
from bt_jax.app.processes.train_command import TrainCommand
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.app.state.record import read_record, read_result
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree, gene_pool
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes
from bt_jax.training.progress import Progress, is_alive, read_progress
from bt_jax.training.run_folder import RunFolder

__all__ = ["Evolution", "Stage"]

Stage = Literal[
    "none",
    "starting",
    "evolving",
    "paused",
    "stopping",
    "testing",
    "finished",
    "stopped",
    "failed",
    "killed",
    "vanished",
]
RUNNING = ("starting", "evolving", "paused", "stopping", "testing")


class Evolution:
    """`run` is the name of the run folder, `stage` where it is, `progress` what was last heard of it.

    `poll` says whether something has changed. Everything that is asked for and cannot be done raises UserError.
    """

    def __init__(self, workspace: Workspace, reserve: WarmWorker | None = None) -> None:
        self.workspace = workspace
        self.run: str | None = None
        self.stage: Stage = "none"
        self.progress: Progress | None = None
        self.gone = False  # whether somebody has removed the run folder
        self.task: Task | None = None  # that it evolves for
        self.tree: Tree | None = None  # the best so far
        self.result: dict[str, Any] | None = None  # `result.json`, where the best tree has been tested
        self.phases: tuple[int, ...] = ()  # generations at which something was taught
        self._process: WarmWorker | None = None  # where this page has started it
        self._reserve = reserve
        self._prepared: Any = None  # what the reserve compiles for, None where it was told nothing yet
        self._stopping = False
        self._halt: bool | None = None  # what was asked for last and not yet seen
        self._read_at: int | None = None  # modification time of what was read last
        self._orders = TrainCommand()

    @property
    def running(self) -> bool:
        """Whether the process lives, paused or not."""
        return self.stage in RUNNING

    @property
    def sentence(self) -> str:
        """Where it is, in words."""
        now = self.progress.generation if self.progress else 0
        if self.gone and self.running:
            return "The folder of this run has vanished; it is made anew, and what is evolved goes there."
        return {
            "none": "Press Start: trees of steps are tried, and the best improved, until one does the task.",
            "starting": "Getting ready; the first time, this takes some seconds.",
            "evolving": "Evolving.",
            "paused": "Paused; resume when you like.",
            "stopping": "Stopping after this generation.",
            "testing": "Testing the best tree in layouts that it has never seen.",
            "finished": f"Finished at generation {now}.",
            "stopped": f"Stopped at generation {now}; what was learnt is kept."
            if self.progress and self.progress.best is not None
            else "Stopped before the first generation; nothing was learnt.",
            "failed": self._why(),
            "killed": f"The process that evolved was killed after generation {now}; go on, and it continues from its "
            "last checkpoint.",
            "vanished": f"The folder of the run {self.run} has vanished; choose another run, or start again.",
        }[self.stage]

    def prepare(self, task: Task, gp: GPConfig) -> None:
        """Keeps a process in reserve that has compiled for such an evolution, unless one is running."""
        if self.running:
            return
        key = gene_pool(task).leaves, dataclasses.replace(gp, seed=0, generations=1)
        alive = self._reserve is not None and self._reserve.alive
        if alive and self._prepared == key:
            return
        if not alive or self._prepared is not None:
            self.discard_reserve()
            self._reserve = WarmWorker()
        self._prepared = key
        self._reserve.warm(self._orders.start(task, gp))

    def discard_reserve(self) -> None:
        """Ends the process in reserve; one that evolves goes on."""
        if self._reserve is not None:
            self._reserve.discard()
        self._reserve = None

    def start(self, task: Task, gp: GPConfig) -> None:
        """Evolves a tree for a task, in a new run folder."""
        self._check_idle()
        gp.check()
        path = unused(self.workspace.runs / f"{task.name}-{datetime.now():%Y%m%d-%H%M%S}")
        self._launch(self._orders.start(task, gp, path))
        self.run, self.task, self.progress, self.tree, self.phases = path.name, task, None, None, ()

    def more(self, generations: int) -> None:
        """Goes on for so many generations more."""
        folder = self._folder()
        total = generations + (self.progress.generation if self.progress else 0)
        self._launch(self._orders.go_on(folder.path, total))

    def next_phase(
        self,
        *,
        generations: int,
        baseline: Tree | None = None,
        target_from: Path | None = None,
        subgoal_from: Path | None = None,
        baseline_index: int | None = None,
    ) -> None:
        """Goes on for so many generations with what demonstrations have taught; see `bt_jax.training.phases.Changes`."""
        folder = self._folder()
        now = self.progress.generation if self.progress else 0
        changes = Changes(baseline, target_from=target_from, subgoal_from=subgoal_from, baseline_index=baseline_index)
        self._launch(self._orders.go_on(folder.path, now + generations, changes))

    def pause(self) -> None:
        """Halts the process where it is."""
        if self.stage != "evolving":
            raise UserError("nothing is evolving that could be paused; start an evolution first")
        self._signal(signal.SIGSTOP)
        self._halt = True

    def resume(self) -> None:
        """Lets a paused process go on."""
        if self.stage != "paused":
            raise UserError("the evolution is not paused; there is nothing to resume")
        self._signal(signal.SIGCONT)
        self._halt = False

    def stop(self) -> None:
        """Ends the evolution after the present generation; what it has found is kept, and tested."""
        if not self.running:
            raise UserError("nothing is evolving that could be stopped; start an evolution first")
        if self._stopping:
            return
        self._stopping = True
        if self.stage == "starting":
            self._signal(signal.SIGKILL)  # it imports and compiles, and has nothing to lose
        elif self.stage != "testing":
            self._signal(signal.SIGINT)
            self._signal(signal.SIGCONT)

    def open(self, name: str) -> None:
        """Shows another run, to go on with it."""
        self._check_idle()
        folder = self.workspace.run(name)
        self.run, self._process, self._read_at, self._stopping = name, None, None, False
        self._halt = None
        record = read_record(folder)
        self._take(record.progress)
        self.task, self.tree, self.result, self.phases = record.config.task, record.tree, record.result, record.phases
        self.stage = self._stage_of_living() if is_alive(folder.path) else self._stage_of_dead()

    def forget(self, name: str) -> None:
        """Shows nothing any more of a run that was deleted."""
        if self.run == name and not self.running:
            self.run, self.stage, self.progress, self.tree, self.result, self.phases = (
                None,
                "none",
                None,
                None,
                None,
                (),
            )

    def find(self) -> str | None:
        """The name of the run that a process is working on, which was started before this page, or else of the newest."""
        names = self.workspace.run_names()
        return next((name for name in names if is_alive(self.workspace.runs / name)), next(iter(names), None))

    def poll(self) -> bool:
        """Looks at what the process has written and whether it lives; whether anything has changed."""
        if self.run is None:
            return False
        before = self.stage, self.progress, self.gone
        path = self.workspace.runs / self.run
        alive = self._process.alive if self._process is not None else is_alive(path)
        self._read(path)
        if alive:
            self.stage = self._stage_of_living()
        elif self.stage in RUNNING:
            self.stage = self._stage_of_dead()
        self.gone = self.progress is not None and not (path / "config.json").is_file()
        if self.gone and not alive:
            self.stage = "vanished"
        if before[0] != self.stage and self.stage in ("evolving", "finished", "stopped"):
            self.result = read_result(RunFolder(path)) if self.stage != "evolving" else None
            with contextlib.suppress(UserError):
                self.task, self.phases = RunFolder(path).config().task, tuple(RunFolder(path).phases())
        return before != (self.stage, self.progress, self.gone)

    def _read(self, path: Path) -> None:
        try:
            changed = (path / "progress.json").stat().st_mtime_ns
        except OSError:
            return
        if changed == self._read_at:
            return
        self._read_at = changed
        found = read_progress(path)
        if found is None or (self._process is not None and found.pid != self._process.process.pid):
            return
        self._take(found)

    def _take(self, progress: Progress | None) -> None:
        if progress is None or not progress.tree:
            self.tree = None
        elif self.progress is None or progress.tree != self.progress.tree:
            self.tree = parse_tree(progress.tree)
        self.progress = progress

    def _stage_of_living(self) -> Stage:
        if not self._heard:
            return "starting"
        if self.progress.stage not in RUNNING:
            return "testing"  # all is written, the process is about to end
        if self._stopping and self.progress.stage == "evolving":
            return "stopping"
        return "paused" if self.progress.stage == "evolving" and self._halted() else self.progress.stage

    def _stage_of_dead(self) -> Stage:
        if self._heard and self.progress.stage not in RUNNING:
            return self.progress.stage
        if self._stopping and self.stage == "starting":
            return "stopped"
        if self._process is not None and self._process.process.returncode > 0:
            return "failed"
        return "stopped" if self.progress is None else "killed"

    def _halted(self) -> bool:
        """Whether the process is paused; what was asked for counts until it is seen, since signals take a moment."""
        seen = _is_halted(self._pid())
        if self._halt is not None and self._halt != seen:
            return self._halt
        self._halt = None
        return seen

    @property
    def _heard(self) -> bool:
        """Whether the progress is that of the present process, not of one before it."""
        return self.progress is not None and self.progress.pid == self._pid()

    def _why(self) -> str:
        """Why it has failed."""
        if self._heard and self.progress.message:
            return self.progress.message
        return self._process.last_words() if self._process else "The evolution has failed."

    def _pid(self) -> int | None:
        if self._process is not None:
            return self._process.process.pid
        return None if self.progress is None else self.progress.pid

    def _signal(self, number: signal.Signals) -> None:
        try:
            os.kill(self._pid(), number)
        except (ProcessLookupError, PermissionError, TypeError):
            self.poll()

    def _check_idle(self) -> None:
        if self.running:
            raise UserError("an evolution is running; stop it first")

    def _folder(self) -> RunFolder:
        """The run folder to go on in."""
        self._check_idle()
        if self.run is None:
            raise UserError("nothing has been evolved yet; start an evolution first")
        return self.workspace.run(self.run)

    def _launch(self, words: Sequence[str]) -> None:
        reserve = self._reserve if self._reserve is not None and self._reserve.alive else WarmWorker()
        self._reserve = self._prepared = None
        reserve.train([*words, "--progress"])
        self._process, self._read_at = reserve, None
        self.stage, self.result, self._stopping, self._halt = "starting", None, False, None


def _is_halted(pid: int) -> bool:
    """Whether a process has been stopped by a signal (Linux)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"
    except (OSError, IndexError):
        return False
