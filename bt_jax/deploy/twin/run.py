"""A whole run of a tree on a robot's twin: simulated cell, rendered camera, perception, link, skills, executor.

In lock-step the simulation waits for the program, as fast as both go: what a run does depends only on its seed. In real time
the controller keeps its 250 Hz and perception looks in a thread of its own, as on a robot.
"""

from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.executor import Executor
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.observer import Observer, Perceiving
from bt_jax.deploy.execution.outcome import RunOutcome, TickReport
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import SIMULATED_TICK, TWIN_SECONDS, Limits
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.protocol import Counters
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.perception.threaded import BackgroundPerception
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.planning.timing import Pace
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.twin.cell import CAMERA, TwinScene, build_scene, solved, target_distances
from bt_jax.deploy.twin.controller import Controller, ControllerStats
from bt_jax.deploy.twin.disturbances import disturbance as disturbance_named
from bt_jax.deploy.twin.disturber import Disturbance, Disturber
from bt_jax.deploy.twin.fault_injector import FaultInjector, check_faults
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.person import Person, Touch
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.deploy.twin.settings import Realism
from bt_jax.tasks import Task

__all__ = ["Interference", "TwinRun", "TwinTick", "run_twin"]

DISTURBED = (2.0, 25.0)  # seconds within which the person comes, before a run of three boxes ends
WAITING = 60.0  # seconds by the clock that simulated time may stand still for a plan


@dataclasses.dataclass(frozen=True)
class TwinTick:
    """One tick of a run, for displays and films: the executor's own view, the true state, and what a person just did."""

    shown: TickReport
    qpos: Float[np.ndarray, " nq"]
    touch: Touch | None


@runtime_checkable
class Interference(Protocol):
    """Who or what interferes with a run: called at each tick with the time [s], it returns what it did last, None for
    nothing; `touches` is all that it did."""

    @property
    def touches(self) -> list[Touch]:
        """All that it did."""

    def __call__(self, now: float, shown: TickReport) -> Touch | None:
        """Return what happens now, None if nothing."""


@dataclasses.dataclass(frozen=True)
class TwinRun:
    """How a run in the twin went; `solved` and `distances` [m] are true ones, of the simulation."""

    seed: int
    outcome: RunOutcome
    solved: bool
    distances: tuple[float, ...]
    touches: tuple[Touch, ...]
    start: float  # of the run, by the clock of the touches, s
    stats: ControllerStats
    counters: Counters
    seconds: float  # of the wall clock

    @property
    def exit_code(self) -> int:
        """That of the executor; FAILED also if the tree succeeds and an object is not where its target is."""
        return self.outcome.exit_code


def run_twin(
    robot: RobotModel,
    program: Program,
    seed: int,
    *,
    realtime: bool = False,
    disturbances: int = 0,
    log: Path | None = None,
    limits: Limits | None = None,
    pace: Pace | None = None,
    on_tick: Callable[[TwinTick], None] | None = None,
    prepare: Callable[[Controller, Perceiving], None] | None = None,
    visitor: Callable[[TwinScene, Controller, np.random.Generator], Interference] | None = None,
    realism: Realism | None = None,
    disturbance: str | None = None,
    draw: int = 0,
) -> TwinRun:
    """Run a tree on a robot in one layout, in a cell as real as `realism` says, by default as a real one. `prepare` may
    break things before the run begins. A person comes `disturbances` times; what `visitor` makes interferes, too, as it
    is told from outside; `disturbance` names what else happens, see `twin.disturbances`. Where the program's task has
    faults, these happen instead, as the `draw` of this layout says, and success has to last as long as in the
    simulation, if it can be undone.

    Raise UserError if nothing can be rendered here, so that the camera would see nothing, or if a fault cannot happen here.
    """
    began, faults = time.monotonic(), program.task.faults
    check_faults(program.task, realtime=realtime)
    if faults is not None and (disturbances or disturbance is not None):
        raise UserError("the task has faults, which include what a person does; leave out the disturbances")
    happens = Disturbance() if disturbance is None else disturbance_named(disturbance)
    realism = happens.change(realism or Realism())
    scene = build_scene(robot, program.task, seed, realism, stranger=happens.stranger)
    ports = free_ports(robot.arm_names)
    rng = np.random.default_rng([seed, 1])
    with contextlib.ExitStack() as stack:
        controller = stack.enter_context(Controller(scene.cell, ports=ports, realtime=realtime, realism=scene.realism))
        perception = stack.enter_context(_perception(scene, controller, seed, background=realtime))
        config = link_config(robot, "127.0.0.1", ports, controller.rws_port, motion=True)
        rules = cell_rules(robot, program.task)
        if not realtime:
            rules = dataclasses.replace(rules, idle=WAITING)
        link = stack.enter_context(Irc5Link(config, rules, controller))
        log_file = stack.enter_context(Log(log))
        planning = stack.enter_context(PlanningProcess(robot, program.task)) if realtime else None
        skills = RobotSkills(robot, program.task, link, pace=pace, background=planning)
        first = link.now()
        times = [first + float(t) for t in rng.uniform(*DISTURBED, disturbances)]
        camera = None if realtime else perception.camera  # type: ignore[attr-defined]
        person: Person | Disturber | FaultInjector = Person(scene, controller, rng, times)
        if faults is not None:
            person = FaultInjector(program, scene, controller, camera, seed, draw, first)
        elif disturbance is not None:
            person = Disturber(disturbance, happens, scene, controller, camera, np.random.default_rng([seed, 4]), first)

        causes: list[Interference] = [person]
        if visitor is not None:
            causes.append(visitor(scene, controller, np.random.default_rng([seed, 5])))
        qpos, stats = controller.state()[1], controller.stats()

        def tick(shown: TickReport) -> None:
            nonlocal qpos
            qpos = controller.state()[1]
            touch = None
            for cause in causes:
                known = len(cause.touches)
                touch = cause(link.now(), shown) or touch
                for each in cause.touches[known:]:
                    log_file.write("disturbance", time=each.time, what=each.what, box=each.box)
            if on_tick is not None:
                on_tick(TwinTick(shown, qpos, touch))

        def verify() -> str:
            return "" if solved(person.scene, controller.state()[1]) else "not every object is where its target is"

        executor = Executor(
            program,
            skills=skills,
            link=link,
            observe=Observer(robot, program.task, link=link, perception=perception, grasped=lambda: skills.grasped),
            log=log_file,
            limits=_lasting(limits or Limits(run=TWIN_SECONDS), program.task),
            settings=_settings(seed, realtime, disturbances, scene.realism)
            | {"disturbance": disturbance, "draw": None if faults is None else draw},
            on_tick=tick,
            verify=verify,
        )
        if prepare is not None:
            prepare(controller, perception)
        link.start()
        start = link.now()
        outcome = executor.run()
        with contextlib.suppress(UserError):  # of a controller that died while it told its state: what was known last
            qpos, stats = controller.state()[1], controller.stats()
        return TwinRun(
            seed=seed,
            outcome=outcome,
            solved=solved(person.scene, qpos),
            distances=tuple(target_distances(person.scene, qpos)),
            touches=tuple(sorted((each for cause in causes for each in cause.touches), key=lambda touch: touch.time)),
            start=start,
            stats=stats,
            counters=link.counters(),
            seconds=time.monotonic() - began,
        )


def _lasting(limits: Limits, task: Task) -> Limits:
    """Return the limits of a run in which success may be undone by what happens behind ticks."""
    faults = task.faults
    if faults is None or not (faults.hide or faults.move or faults.take):
        return limits
    return dataclasses.replace(limits, success=max(limits.success, SIMULATED_TICK * task.episode.success_ticks))


@contextlib.contextmanager
def _perception(scene: TwinScene, controller: Controller, seed: int, *, background: bool) -> Iterator[Perceiving]:
    def make() -> Perception:
        camera = RenderedCamera(scene.model, controller.state, CAMERA, realism=scene.realism, seed=[seed, 3])
        return Perception(scene.task, camera, scene.calibrated)

    if background:
        with BackgroundPerception(make, lambda made: made.camera.close()) as looking:
            yield looking
        return
    perception = make()
    try:
        yield perception
    finally:
        perception.camera.close()


def _settings(seed: int, realtime: bool, disturbances: int, realism: Realism) -> dict[str, Any]:
    return {
        "robot": "twin",
        "seed": seed,
        "realtime": realtime,
        "disturbances": disturbances,
        "realism": realism.logged(),
    }
