"""The jobs of the process of the robot's twin: run a tree, look at what must be in order before a real run, replay a log."""

from __future__ import annotations

import queue
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np

from bt_jax._util.yaml_files import to_yaml
from bt_jax.app.processes.twin_messages import (
    Check,
    Ended,
    Item,
    Job,
    Message,
    Person,
    Picture,
    Replay,
    Request,
    Run,
    Said,
    Show,
    Tick,
)
from bt_jax.deploy.commands.arguments import REDUCED_SPEED, CheckArguments
from bt_jax.deploy.commands.display import doubts
from bt_jax.deploy.commands.real_cell import open_real_cell
from bt_jax.deploy.execution.observer import Perceiving
from bt_jax.deploy.execution.preflight import preflight
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.recorded import read_run
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.perception.arrays import ColorImage
from bt_jax.deploy.perception.drawing import draw_detections
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import TwinScene
from bt_jax.deploy.twin.cell_view import CellView
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.instructed_person import InstructedPerson, Instruction
from bt_jax.deploy.twin.recorded_cell import RecordedCell
from bt_jax.deploy.twin.run import TwinTick, run_twin
from bt_jax.deploy.twin.settings import Realism
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.tasks import task_from_dict

__all__ = ["do"]

Say = Callable[[Message], None]
Requests = queue.SimpleQueue[Request]
CAMERA = Realism(width=960, height=720, rate=5.0)  # fewer and smaller images than a robot's: the page wants a core, too
CELL = (800, 450)  # px of pictures of the cell
PERIOD = 0.4  # seconds by the clock between two of them
QUALITY = 80  # of JPEG


def do(job: Job, requests: Requests, say: Say) -> None:
    """Do a job. Raise UserError if it cannot be done, KeyboardInterrupt if it was broken off."""
    match job:
        case Run():
            _run(job, requests, say)
        case Check():
            _check(job, say)
        case Replay():
            _replay(job, requests, say)


def _run(job: Run, requests: Requests, say: Say) -> None:
    program = Program(task_from_dict(job.task, source="the task of the page", kept=True), parse_tree(job.tree))
    window = _Window(program, requests, say)
    try:
        run = run_twin(
            YUMI,
            program,
            job.seed,
            log=Path(job.log),
            on_tick=window.tick,
            prepare=window.look_through,
            visitor=window.enter,
            realism=CAMERA,
        )
    finally:
        window.close()
    outcome = run.outcome
    interrupted = outcome.exit_code == Exit.INTERRUPTED
    say(Ended(outcome.reason, outcome.seconds, solved=outcome.exit_code == Exit.DONE, interrupted=interrupted))


class _Window:
    """Tells the page what a run does, no faster than a robot would do it, and passes on what the page asks for."""

    def __init__(self, program: Program, requests: Requests, say: Say) -> None:
        self.task, self._requests, self._say = program.task, requests, say
        self._perception: Perception | None = None
        self._view: CellView | None = None
        self._person: InstructedPerson | None = None
        self._begun: tuple[float, float] | None = None  # in the time of the run, and by the clock
        self._pictured = float("-inf")  # time of the image that was shown last
        self._drawn = float("-inf")  # when the cell was drawn last, by the clock

    def look_through(self, controller: Controller, perception: Perceiving) -> None:
        """Show what the robot's camera sees."""
        assert isinstance(perception, Perception)
        self._perception = perception

    def enter(self, scene: TwinScene, controller: Controller, rng: np.random.Generator) -> InstructedPerson:
        """Return the person in the cell."""
        self._view = CellView(scene, width=CELL[0], height=CELL[1], shadows=False)
        self._person = InstructedPerson(
            scene, controller, rng, self._instructions, lambda text: self._say(Said(text, refused=True))
        )
        return self._person

    def tick(self, now: TwinTick) -> None:
        """Tell of a tick."""
        shown, seen = now.shown, now.shown.seen
        self._begun = self._begun or (seen.time, time.monotonic())
        begun, clock = self._begun
        if now.touch is not None:
            self._say(Said(str(now.touch), refused=False))
        names = (*self.task.object_names, *self.task.kit_names)
        statuses = (
            None if shown.statuses is None else "".join("." if s is None else str(int(s)) for s in shown.statuses)
        )
        action = None if shown.action is None else str(shown.action)
        ages = {name: seen.time - seen.measured[name] if name in seen.measured else None for name in names}
        unsure, away = doubts(self.task, seen), [] if self._person is None else self._person.away
        self._say(Tick(seen.time - begun, statuses, shown.phase, action, seen.holding, unsure, away, ages))
        self._draw(now)
        time.sleep(max(0.0, (seen.time - begun) - (time.monotonic() - clock)))

    def close(self) -> None:
        """Give the OpenGL context back."""
        if self._view is not None:
            self._view.close()

    def _instructions(self) -> Iterator[Instruction]:
        while not self._requests.empty():
            request = self._requests.get()
            if isinstance(request, Person):
                yield Instruction(request.what, request.box, request.start, request.end)

    def _draw(self, now: TwinTick) -> None:
        perception, clock = self._perception, time.monotonic()
        if perception is not None and perception.image > self._pictured:
            self._pictured = perception.image
            picture = draw_detections(perception.camera.read(), perception.detections, self.task)
            self._say(Picture("camera", _jpeg(picture)))
        if self._view is not None and clock - self._drawn >= PERIOD:
            self._drawn = clock
            self._say(Picture("cell", _jpeg(self._view(now.qpos))))


def _check(job: Check, say: Say) -> None:
    """Look at all that needs no controller and no camera, and say of the rest what it needs."""
    with tempfile.TemporaryDirectory(prefix="bt_jax-") as scratch:
        tree, task = Path(scratch) / "tree.txt", Path(scratch) / "task.yaml"
        tree.write_text(job.tree, encoding="utf-8")
        task.write_text(to_yaml(job.task), encoding="utf-8")
        log = None if job.twin_log is None else Path(job.twin_log)
        arguments = CheckArguments(tree, str(task), twin_log=log)
        with open_real_cell(arguments, motion=False, override=REDUCED_SPEED) as cell:
            for item in preflight(cell.equipment):
                say(Item(item.name, item.passed, item.detail))


def _replay(job: Replay, requests: Requests, say: Say) -> None:
    """Draw what was asked for last, until the page goes."""
    cell = RecordedCell(YUMI, read_run(Path(job.log)), width=CELL[0], height=CELL[1])
    try:
        while True:
            request = requests.get()
            while not requests.empty():
                request = requests.get()
            if isinstance(request, Show):
                say(Picture("cell", _jpeg(cell(request.at))))
    finally:
        cell.close()


def _jpeg(picture: ColorImage) -> bytes:
    encoded = cv2.imencode(".jpg", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    return encoded.tobytes()
