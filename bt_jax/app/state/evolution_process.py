"""The evolution that the page shows: a process of its own, `bt_jax.train`, which outlives the page and is found again.

Nothing here waits: the process is told by signals or lines on a pipe, and `poll` reads what it has written.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from bt_jax._util.errors import UserError
from bt_jax._util.files import unused
from bt_jax.app.phrases import phrase
from bt_jax.app.processes.standby import Standby
from bt_jax.app.processes.train_command import ANYWHERE, NO_CHANGES, Beginning, TrainCommand
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.app.state.run_record import read_record, read_result
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes
from bt_jax.training.progress import Progress, is_alive, read_progress
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder

__all__ = ["EvolutionProcess", "EvolutionStage"]

EvolutionStage = Literal[
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


class EvolutionProcess:
    """`run` is the name of the run folder, `stage` and `progress` are what was last heard of it, `task` is its task.

    `poll` returns whether something has changed. A request that cannot be met raises UserError.
    """

    def __init__(self, workspace: Workspace, warm_worker: WarmWorker | None = None) -> None:
        """Work in a workspace; the first evolution is done by `warm_worker`, if one was started already."""
        self.workspace = workspace
        self.run: str | None = None
        self.stage: EvolutionStage = "none"
        self.progress: Progress | None = None
        self.gone = False  # whether somebody has removed the run folder
        self.config: RunConfig | None = None  # of the run, once it is known
        self.task: Task | None = None
        self.gp = GPConfig()  # of the last evolution that was started here, and probably of the next
        self.tree: Tree | None = None  # the best so far
        self.result: dict[str, Any] | None = None  # `result.json`, once the best tree has been tested
        self.phases: tuple[int, ...] = ()  # generations at which something was taught
        self._process: WarmWorker | None = None  # None if an earlier page has started the process
        self._command = TrainCommand(workspace.inputs)
        self._standby = Standby(self._command, warm_worker)
        self._stopping = False
        self._halt: bool | None = None  # what was asked for last and not yet seen
        self._read_at: int | None = None  # modification time of what was read last

    @property
    def running(self) -> bool:
        """Whether the process is alive, paused or not."""
        return self.stage in RUNNING

    @property
    def sentence(self) -> str:
        """Where it is, in words."""
        now = self.progress.generation if self.progress else 0
        if self.gone and self.running:
            return "The folder of this run has vanished; it is created again with the next checkpoint."
        return {
            "none": "Press “Find a tree”: it is planned, and if that does not do, evolved until one does the task.",
            "starting": "Getting ready; the first time, this takes some seconds.",
            "evolving": "Evolving.",
            "paused": "Paused; press Resume to go on.",
            "stopping": "Stopping after this generation.",
            "testing": "Testing the best tree in starts that it has never seen.",
            "finished": f"Finished after {now} generations." if now else "Finished.",
            "stopped": f"Stopped at generation {now}; what was learnt is kept."
            if self.progress and self.progress.best is not None
            else "Stopped before the first generation; nothing was learnt.",
            "failed": self._failure(),
            "killed": f"The process was killed after generation {now}; go on, and it continues from its last checkpoint.",
            "vanished": f"The folder of the run {self.run} has vanished; choose another run, or start again.",
        }[self.stage]

    def prepare(self, task: Task) -> None:
        """Keep a process on standby that has compiled for an evolution of a task, unless one is running."""
        if not self.running:
            self._standby.prepare(task, self.gp)

    def close(self) -> None:
        """End the process on standby; an evolution goes on."""
        self._standby.discard()

    def start(self, task: Task, gp: GPConfig, begin: Beginning = ANYWHERE) -> None:
        """Evolve a tree for a task, in a new run folder."""
        self._check_idle()
        gp.check()
        path = unused(self.workspace.runs / f"{task.name}-{datetime.now():%Y%m%d-%H%M%S}")
        self._launch(self._command.start(task, gp, path, begin))
        self.run, self.task, self.gp, self.progress, self.tree, self.phases = path.name, task, gp, None, None, ()
        self.config = None

    def go_on(self, generations: int, changes: Changes = NO_CHANGES) -> None:
        """Evolve for more generations; with changes, in a new phase."""
        folder = self._folder()
        heard, checkpoint = self.progress.generation if self.progress else 0, folder.load_checkpoint()
        now = max(heard, checkpoint.state.generation if checkpoint is not None else 0)  # written before it is reported
        self._launch(self._command.go_on(folder.path, now + generations, changes))

    def pause(self) -> None:
        """Halt the process."""
        if self.stage != "evolving":
            raise UserError("nothing can be paused now; start an evolution first, or wait until it evolves")
        self._signal(signal.SIGSTOP)
        self._halt = True

    def resume(self) -> None:
        """Let a paused process go on."""
        if self.stage != "paused":
            raise UserError("the evolution is not paused; there is nothing to resume")
        self._signal(signal.SIGCONT)
        self._halt = False

    def stop(self) -> None:
        """End the evolution after the present generation; its best tree is kept and tested."""
        if not self.running:
            raise UserError("no evolution is running; start an evolution first")
        if self._stopping:
            return
        self._stopping = True
        if self.stage == "starting":
            self._signal(signal.SIGKILL)  # it imports and compiles, and has nothing to lose
        elif self.stage != "testing":
            self._signal(signal.SIGINT)
            self._signal(signal.SIGCONT)

    def open(self, name: str) -> None:
        """Show another run."""
        self._check_idle()
        folder = self.workspace.run(name)
        self.run, self._process, self._read_at, self._stopping, self._halt = name, None, None, False, None
        record = read_record(folder)
        self._take(record.progress)
        self.config, self.task, self.tree = record.config, record.config.task, record.tree
        self.result, self.phases = record.result, record.phases
        self.stage = self._stage_of_living() if is_alive(folder.path) else self._stage_of_dead()

    def forget(self, name: str) -> None:
        """Show nothing of a run that was deleted."""
        if self.run == name and not self.running:
            self.run, self.stage, self.progress, self.config, self.task = None, "none", None, None, None
            self.tree, self.result, self.phases = None, None, ()

    def find(self) -> str | None:
        """Return the name of a run that a process is working on, started before this page, or else of the newest run."""
        names = self.workspace.run_names()
        return next((name for name in names if is_alive(self.workspace.runs / name)), next(iter(names), None))

    def poll(self) -> bool:
        """Read what the process has written and whether it is alive; return whether anything has changed."""
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
        if before[0] != self.stage and self.stage in ("evolving", "testing", "finished", "stopped"):
            self.result = read_result(RunFolder(path)) if self.stage in ("finished", "stopped") else None
            with contextlib.suppress(UserError):
                self.config, self.phases = RunFolder(path).config(), tuple(RunFolder(path).phases())
                self.task = self.config.task
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
        if found is None or (self._process is not None and found.pid != self._process.pid):
            return
        self._take(found)

    def _take(self, progress: Progress | None) -> None:
        if progress is None or not progress.tree:
            self.tree = None
        elif self.progress is None or progress.tree != self.progress.tree:
            self.tree = parse_tree(progress.tree)
        self.progress = progress

    def _stage_of_living(self) -> EvolutionStage:
        heard = self._heard
        if heard is None:
            return "starting"
        if heard.stage not in RUNNING:
            return "testing"  # all is written, the process is about to end
        if self._stopping and heard.stage == "evolving":
            return "stopping"
        return "paused" if heard.stage == "evolving" and self._halted(heard.pid) else heard.stage

    def _stage_of_dead(self) -> EvolutionStage:
        heard = self._heard
        if heard is not None and heard.stage not in RUNNING:
            return heard.stage
        if self._stopping and self.stage == "starting":
            return "stopped"
        if self._process is not None and self._process.failed:
            return "failed"
        return "stopped" if self.progress is None else "killed"

    def _halted(self, pid: int) -> bool:
        """Whether the process is paused; what was asked for counts until it is seen, since signals take a moment."""
        seen = _is_halted(pid)
        if self._halt is not None and self._halt != seen:
            return self._halt
        self._halt = None
        return seen

    @property
    def _heard(self) -> Progress | None:
        """The progress of the present process, None if only that of an earlier one is known."""
        return self.progress if self.progress is not None and self.progress.pid == self._pid() else None

    def _failure(self) -> str:
        """Return why it has failed."""
        said = self._heard.message if self._heard is not None else ""
        if not said and self._process is not None:
            said = self._process.last_words()
        return phrase(said, self.workspace.root) if said else "The evolution has failed."

    def _pid(self) -> int | None:
        if self._process is not None:
            return self._process.pid
        return None if self.progress is None else self.progress.pid

    def _signal(self, number: signal.Signals) -> None:
        pid = self._pid()
        if pid is None:
            return
        try:
            os.kill(pid, number)
        except (ProcessLookupError, PermissionError):
            self.poll()

    def _check_idle(self) -> None:
        if self.running:
            raise UserError("an evolution is running; stop it first")

    def _folder(self) -> RunFolder:
        """Return the run folder to go on in."""
        self._check_idle()
        if self.run is None:
            raise UserError("nothing has been evolved yet; start an evolution first")
        return self.workspace.run(self.run)

    def _launch(self, words: Sequence[str]) -> None:
        process = self._standby.take()
        process.train([*words, "--progress"])
        self._process, self._read_at = process, None
        self.stage, self.result, self._stopping, self._halt = "starting", None, False, None


def _is_halted(pid: int) -> bool:
    """Return whether a process has been stopped by a signal (Linux)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "T"
    except (OSError, IndexError):
        return False
