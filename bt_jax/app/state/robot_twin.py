"""A tree on the robot's twin: started, watched, disturbed and stopped from the page, in a process of its own."""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Literal

from bt_jax._util.errors import UserError
from bt_jax._util.files import unused
from bt_jax.app.processes.twin_messages import (
    Check,
    Ended,
    Failed,
    Item,
    Job,
    Message,
    Person,
    Picture,
    Replay,
    Run,
    Said,
    Show,
    Tick,
)
from bt_jax.app.processes.twin_process import TwinProcess
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.edited_task import EditedTask
from bt_jax.app.state.playing import Playing
from bt_jax.app.state.worker import Worker
from bt_jax.app.state.workspace import Workspace
from bt_jax.deploy.execution.log_reader import log_ends
from bt_jax.deploy.execution.program import Program, refuse_driving
from bt_jax.deploy.execution.recorded import RecordedRun, read_run
from bt_jax.deploy.planning.feasibility import check_scale
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.drawing.svg import node_ids
from bt_jax.encoding.formats.text import format_tree
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task, task_names

__all__ = ["RobotTwin", "TwinStage", "fitting_task", "misfit"]

TwinStage = Literal["idle", "starting", "running", "stopping"]
NEEDED = ("cv2", "pinocchio", "toppra")  # of the extra, what is heavy
INSTALL = 'pip install -e ".[robot]"'


class RobotTwin:
    """`stage` is where the run is; `tick`, `pictures`, `said` and `ended` are what was heard last of it, and `run` is the
    tree with its task that runs or ran last. `items` are those of the last preflight, `log` that of the twin with which it
    was made, and `record` is the log that is looked back at, at its moment `at`. At most one process works at a time.
    Changes are announced under the topic "robot"."""

    def __init__(
        self,
        bus: Bus,
        worker: Worker,
        workspace: Workspace,
        edited: EditedTask,
        playing: Playing,
        launch: Callable[[Job], TwinProcess] = TwinProcess,
    ) -> None:
        self._bus, self._worker, self._workspace = bus, worker, workspace
        self._edited, self._playing, self._launch = edited, playing, launch
        self.stage: TwinStage = "idle"
        self.run: Program | None = None
        self.tick: Tick | None = None
        self.statuses: dict[str, Status | None] = {}  # of the nodes, by their ids in the drawing
        self.pictures: dict[str, bytes] = {}  # JPEG, by name
        self.numbers: dict[str, int] = {}  # how many pictures of each name there were
        self.said = Said("", refused=False)
        self.ended: Ended | None = None
        self.failure = ""
        self.items: list[Item] = []
        self.checking = False
        self.log: Path | None = None
        self.record: RecordedRun | None = None
        self.record_name = ""
        self.at = 0
        self._number_of_start = 0
        self._process: TwinProcess | None = None

    @property
    def running(self) -> bool:
        """Whether a run is on, from its start to the rest of the arms."""
        return self.stage != "idle"

    @property
    def refusal(self) -> str:
        """Why the tree of step 6 cannot run on the twin, with a remedy; "" if it can."""
        if missing := _missing():
            return (
                f"What the robot's twin needs is not installed ({', '.join(missing)}): run {INSTALL} in a terminal and "
                "start the page again."
            )
        if reason := misfit(self._edited.task):
            return f"{reason[:1].upper()}{reason[1:]}."
        return (
            ""
            if self._playing.tree is not None
            else "There is no tree yet: find one in step 2, or choose one in step 6."
        )

    @property
    def alternative(self) -> str:
        """A task of the package to open instead, since this one does not fit the robot; "" if it does."""
        task = self._edited.task
        return "" if _missing() or not misfit(task) else fitting_task(task)

    def start(self, *, elsewhere: bool = False) -> None:
        """Run the tree of step 6 from where things stood before, or from other places. Raise UserError if it cannot run
        here, or a run is on."""
        self._check_idle()
        program = self._program()
        tree, task = program.tree, program.task
        self._number_of_start += elsewhere
        log = unused(self._workspace.logs / f"{task.name}-{datetime.now():%Y%m%d-%H%M%S}.jsonl")
        self._begin(Run(format_tree(tree), task.to_dict(), self._number_of_start, str(log.resolve())))
        self.run, self.stage = program, "starting"
        self.tick, self.ended, self.record, self.record_name, self.failure = None, None, None, "", ""
        self.statuses, self.pictures, self.said = dict.fromkeys(node_ids(tree)), {}, Said("", refused=False)
        self._bus.changed("robot", "runs")

    def stop(self) -> None:
        """End the run at its next tick; the arms slow down at once. Raise UserError if none is on."""
        if not self.running or self._process is None:
            raise UserError("nothing runs on the robot's twin; press Start first")
        self.stage = "stopping"
        self._process.interrupt()
        self._bus.changed("robot")

    def disturb(self, request: Person) -> None:
        """Have the person in the cell do something. Raise UserError if no run is on."""
        if self.stage != "running" or self._process is None:
            raise UserError("nothing moves on the robot's twin; press Start first")
        self._process.tell(request)

    def check(self) -> None:
        """Look at what must be in order before the tree may move the real robot. Raise UserError as `start` does."""
        self._check_idle()
        program = self._program()
        self.log = log = self.twin_log(program)
        tree, task = format_tree(program.tree), program.task.to_dict()
        self._begin(Check(tree, task, None if log is None else str(log.resolve())))
        self.items, self.checking, self.failure = [], True, ""
        self._bus.changed("robot")

    def twin_log(self, program: Program) -> Path | None:
        """Return the newest log of a run of this tree that has succeeded, else the newest of it, None if there is none."""
        found = [(name, start, end) for name in self._workspace.log_names() for start, end in self._ends(name)]
        own = [(name, end) for name, start, end in found if start.get("digest") == program.digest]
        good = [name for name, end in own if end.get("exit_code") == 0]
        newest = next(iter([*good, *(name for name, _ in own)]), None)
        return None if newest is None else self._workspace.log(newest)

    async def look_back(self, name: str) -> None:
        """Open a log. Raise UserError if it has gone or cannot be read, or a run is on."""
        self._check_idle()
        path = self._workspace.log(name)
        record = await self._worker.work(read_run, path)
        self._check_idle()
        self.pictures, self.failure = {}, ""
        self.record, self.record_name = record, name
        self._begin(Replay(str(path.resolve())))
        self.seek(0)

    def seek(self, at: int) -> None:
        """Show another moment of the log that is open."""
        if self.record is None:
            raise UserError("no run is open; choose one in the list first")
        self.at = min(max(at, 0), len(self.record.moments) - 1)
        if self._process is None:
            self._begin(Replay(str(self._workspace.log(self.record_name).resolve())))
        if self._process is not None and isinstance(self._process.job, Replay):
            self._process.tell(Show(self.at))
        self._bus.changed("robot")

    def poll(self) -> None:
        """Hear what the process says; to be called a few times a second."""
        process = self._process
        if process is None:
            return
        heard = process.take()
        for message in heard:
            self._hear(message)
        if not process.alive:
            self._over(process)
        elif not heard:
            return
        self._bus.changed("robot")

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.close()
            self._process = None

    def _hear(self, message: Message) -> None:
        match message:
            case Tick():
                self.tick = message
                self.stage = "running" if self.stage == "starting" else self.stage
                if message.statuses is not None:
                    found = [None if character == "." else Status(int(character)) for character in message.statuses]
                    self.statuses = dict(zip(self.statuses, found, strict=True))
            case Picture():
                self.pictures[message.name] = message.jpeg
                self.numbers[message.name] = self.numbers.get(message.name, 0) + 1
            case Said():
                self.said = message
            case Item():
                self.items.append(message)
            case Ended():
                self.ended = message
            case Failed():
                self.failure = message.text

    def _over(self, process: TwinProcess) -> None:
        """Take note of the end of a process."""
        if isinstance(process.job, Run) and self.ended is None and not self.failure:
            said = process.last_words()
            self.failure = f"the robot's twin has ended unexpectedly{f' ({said})' if said else ''}; start it again"
        self.checking, self._process = False, None
        if isinstance(process.job, Run):
            self.stage = "idle"
            self._bus.changed("runs")

    def _begin(self, job: Job) -> None:
        """Start a process for another job; one that checks or draws has nothing to lose."""
        if self._process is not None:
            self._process.kill()
        self._process = self._launch(job)

    def _program(self) -> Program:
        """Return the tree of step 6 with its task. Raise UserError if it cannot run here."""
        tree, refusal = self._playing.tree, self.refusal
        if refusal or tree is None:
            raise UserError(f"{refusal[:1].lower()}{refusal[1:].rstrip('.')}")
        return Program(self._edited.task, tree)

    def _check_idle(self) -> None:
        if self.running:
            raise UserError("the robot's twin runs; stop it first")

    def _ends(self, name: str) -> list:
        try:
            return [log_ends(self._workspace.log(name))]
        except UserError:
            return []


def misfit(task: Task) -> str:
    """Return why a task is not one for the robot, with a remedy, "" if it is."""
    try:
        check_scale(YUMI, refuse_driving(task))
    except UserError as refusal:
        return str(refusal)
    return ""


def fitting_task(task: Task) -> str:
    """Return the name of the task of the package that is another one at the robot's scale, else that of an example."""
    name = f"{YUMI.name}_{task.name}"
    return name if name in task_names() else YUMI.example


@functools.cache
def _missing() -> tuple[str, ...]:
    """Return what of the extra [robot] is not installed."""
    return tuple(name for name in NEEDED if importlib.util.find_spec(name) is None)
