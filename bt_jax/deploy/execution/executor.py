"""Ticks a tree on the robot, starts and ends the skills that it asks for, and knows when to stop.

As soon as the tree wants something else, an attempt is broken off smoothly, except in its committed phases (fingers closing,
a box being set down). What cannot be decided, because something is not seen, neither begins nor breaks off an action: the
arms get out of the camera's way first.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from typing import Any, NoReturn

from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, expand, not_reactive
from bt_jax.deploy.execution.action_runner import ActionRunner, Skills
from bt_jax.deploy.execution.decision import Decision, Look, Step, decide
from bt_jax.deploy.execution.diagnosis import Diagnosis, joined
from bt_jax.deploy.execution.log import Log, RunLog, TickEntry
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.outcome import Halt, RunOutcome, TickReport
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.reach_memory import ReachMemory
from bt_jax.deploy.execution.settings import Exit, Limits
from bt_jax.deploy.execution.statuses import Context, Statuses, subgoals_by_sight
from bt_jax.deploy.link.protocol import ControllerGone, RobotLink
from bt_jax.deploy.link.safety import Rejected
from bt_jax.encoding.interpret import TreeMemory
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix

__all__ = ["Executor"]


class Executor:
    """Run a program on a robot. `observe` returns what is known now; `on_tick` receives every tick; `verify`, of a
    simulation that knows the truth, returns how the scene differs from what the tree believes when it has succeeded, "" if
    it does not."""

    def __init__(
        self,
        program: Program,
        *,
        skills: Skills,
        link: RobotLink,
        observe: Callable[[], Observation],
        log: Log,
        limits: Limits | None = None,
        settings: dict[str, Any] | None = None,
        dry: bool = False,
        on_tick: Callable[[TickReport], None] | None = None,
        verify: Callable[[], str] | None = None,
    ) -> None:
        self.program, self.tree = program, expand(program.tree)
        self.nodes = prefix(self.tree)
        self.skills, self.link, self.observe, self.log = skills, link, observe, log
        self.limits, self.settings, self.dry = limits or Limits(), settings or {}, dry
        self.on_tick = on_tick or (lambda shown: None)
        self.verify = verify or (lambda: "")
        self.ticks = self.overruns = 0
        picks = [node.object for node in self.nodes if isinstance(node, Behavior) and node.name == "pick"]
        boxes = sorted({box for name in picks if name is not None for box in program.task.instances[name]})
        leaves = [node for node in self.nodes if isinstance(node, Behavior)]
        self.runner = ActionRunner(skills, link, log, self.limits, dry=dry)
        self._diagnosis = Diagnosis(program.task, leaves, self.runner, self.limits)
        self._reach = ReachMemory(skills, boxes)
        self._entries = RunLog(log, link)
        self._last_seen: dict[str, RigidTransform] = {}
        self._reached: frozenset[str] = frozenset()
        self._memory = TreeMemory()
        self._reactive = not_reactive(self.tree) is None
        self._undecided: frozenset[Behavior] = frozenset()  # conditions, at the last tick
        self._since: tuple[Status, float] = (Status.RUNNING, 0.0)  # what the tree returns, and since when
        self._time = 0.0  # s, when the link was last asked for it
        self._interrupted = False
        self._trace = ""  # of the error that ended the run

    def run(self) -> RunOutcome:
        """Run until the tree has succeeded, or failed for good, or something stops it. The arms hold afterwards."""
        self._time = start = self.link.now()
        self._since, self.runner.rest_at = (Status.RUNNING, start), start
        self._entries.start(self.program, start, self.limits, self.settings, self.dry)
        with self._interruptible():
            end = self._until_halt(start)
            more = self._hold(end.reason) if end.holds else ""
            return self._finish(Halt(f"{end.reason}; {more}", end.code, end.status) if more else end, start)

    def _until_halt(self, start: float) -> Halt:
        """Tick until the run is over; return why it is."""
        try:
            while True:
                self._step(start)
        except Halt as halt:
            return halt
        except KeyboardInterrupt:
            return Halt("interrupted", Exit.INTERRUPTED)
        except ControllerGone as gone:
            return Halt(f"controller: {gone}", Exit.STOPPED)
        except Exception as error:
            self._trace = traceback.format_exc()
            return Halt(f"{type(error).__name__}: {error}", Exit.STOPPED)

    def _step(self, start: float) -> None:
        """Tick once and act on it. Raise Halt if the run is over."""
        began = time.monotonic()
        self._time = now = self.link.now()
        self._check(now, start)
        seen = self.observe()
        if not abs(seen.time - seen.image) <= self.limits.image:
            why = f": {seen.lost}" if seen.lost else ""
            raise Halt(f"camera: no new image for {seen.time - seen.image:.1f} s{why}", Exit.STOPPED)
        wrong = self._diagnosis.take(seen)
        if wrong and not self._committed:
            raise self._failed(wrong, now)
        self._reached |= subgoals_by_sight(self.program.task, seen)
        self.runner.poll(seen, now)
        decision = None
        context = self._context(seen)
        look = Look(self.runner.looking, self.runner.looked, self._undecided)
        if self._committed:
            phase = "committed"
        elif self._diagnosis.doubt:
            phase = self._pause(self._diagnosis.doubt, now)
        elif now < self.runner.rest_at:
            phase = "settling"
        else:
            times = {"now": now, "patience": self.limits.look, "tick": self.limits.tick}
            decision = decide(self.program, self.tree, seen, context, look, self._memory, **times)
            phase = self._act(decision, seen, now)
        self.overruns += self.link.now() - now > self.limits.tick  # never where time is simulated: it waits for us
        self._record(TickEntry(now, seen, context, look, decision, phase, time.monotonic() - began))
        self.link.wait(now + self.limits.tick)

    @property
    def _committed(self) -> bool:
        """Is an attempt in a phase that only a stop of the robot breaks off?"""
        return self.runner.action is not None and self.skills.committed

    def _check(self, now: float, start: float) -> None:
        self._check_stops()
        if not now - start <= self.limits.run + (self.limits.action if self._committed else 0.0):
            raise self._failed(joined(f"the time is up ({self.limits.run:g} s)", self._diagnosis.troubles()), now)

    def _check_stops(self) -> None:
        if self._interrupted:
            raise Halt("interrupted", Exit.INTERRUPTED)
        reason = self.link.stopped()
        if reason is not None:
            during = "" if self.runner.action is None else f", during {self.runner.action}"
            raise Halt(f"{reason}{during}", Exit.STOPPED)

    def _context(self, seen: Observation) -> Context:
        self._last_seen.update(seen.poses)
        return Context(
            attempt=self.runner.action,
            exhausted=self.runner.exhausted(self.program.task.episode.action_ticks),
            reached=self._reached,
            unreachable=self._reach.unreachable(seen, ask=self.runner.action is None),
            last=self._last_seen,
        )

    def _act(self, decision: Decision, seen: Observation, now: float) -> str:
        """Begin, go on with or break off; return what is being done in a word."""
        self.runner.forgive(self.program.task, seen)
        statuses = Statuses(self.program.task, seen, Context())
        self.runner.achieved(frozenset(filter(statuses.holds, self._diagnosis.conditions)))
        self.runner.looked, self._undecided = decision.look.looked, decision.look.undecided
        self._reached |= decision.reached
        self._memory, ticked, wanted = decision.memory, decision.ticked, decision.wanted
        if not self._reactive and ticked.status != Status.RUNNING and decision.step in (Step.HALTING, Step.WAITING):
            self._conclude(ticked.status, decision.look.undecided, now)
        if self.runner.action is None and decision.step != Step.WAITING:
            self._since = (Status.RUNNING, now)
        match decision.step:
            case Step.HALTING if self.runner.action is not None:
                done = all(map(statuses.holds, self.runner.action.postconditions))
                self.runner.cancel(now, f"the tree wants {wanted or ticked.status.name}", done=done)
                repeated = self._diagnosis.repeated()
                if repeated:
                    raise self._failed(repeated, now)
            case Step.HALTING:
                self.runner.cancel(now, "seen")
            case Step.LOOKING:
                if not self.runner.looking and self.runner.looked is None and not self.dry:
                    self.runner.look(now)
            case Step.STARTING:
                assert wanted is not None
                looked = decision.look.looked is not None
                hopeless = self._diagnosis.hopeless(wanted, decision.look.undecided, now, looked=looked)
                if hopeless and not self.dry:
                    raise self._failed(hopeless, now)
                return self.runner.start(wanted, seen, now)
            case Step.WAITING:
                self._judge(ticked.status, decision.look.undecided, now)
        return str(decision.step)

    def _pause(self, doubt: str, now: float) -> str:
        """Break off what would be done on wrong knowledge; arms may go on out of the camera's way."""
        if self.runner.action is not None:
            self.runner.cancel(now, doubt)
        return "pausing"

    def _judge(self, status: Status, undecided: frozenset[Behavior], now: float) -> None:
        """Judge whether the run is over when the tree wants nothing. Success must be seen with the arms out of the way."""
        if self._since[0] != status:
            self._since = (status, now)
            if status == Status.SUCCESS and not self.runner.looking:
                self.runner.look(now)
        lasted = now - self._since[1]
        if status == Status.SUCCESS and not self.runner.looking and lasted >= self.limits.success:
            self._conclude(status, undecided, now)
        if status == Status.FAILURE and lasted >= self._diagnosis.patience(undecided, now):
            self._conclude(status, undecided, now)

    def _conclude(self, status: Status, undecided: frozenset[Behavior], now: float) -> NoReturn:
        """Raise Halt, since the tree has succeeded or failed for good. A tree that is not reactive does so at once: ticked
        again, it would begin from the start."""
        if status == Status.SUCCESS:
            self._rest("the tree has succeeded", now)
            wrong = self.verify()
            raise Halt(
                f"the tree has succeeded{wrong and f', but {wrong}'}", Exit.FAILED if wrong else Exit.DONE, status
            )
        unreachable = [f"{name} is out of reach" for name in self._reach.known_unreachable()]
        troubles = [*unreachable, *self._diagnosis.troubles(undecided)]
        raise self._failed(joined("the tree has failed", troubles), now, status)

    def _failed(self, reason: str, now: float, status: Status = Status.RUNNING) -> Halt:
        """Bring the arms to rest, and return the end of a run that has failed."""
        self._rest(reason, now)
        return Halt(reason, Exit.FAILED, status)

    def _rest(self, reason: str, now: float) -> None:
        """Break off what is under way, and wait until the arms rest. Raise Halt if the robot was stopped or the run was
        interrupted meanwhile."""
        if self.runner.action is not None or self.runner.looking:
            self.runner.cancel(now, reason)
        self.link.wait(max(now, self.runner.rest_at))
        self._check_stops()

    def _record(self, entry: TickEntry) -> None:
        self.ticks += 1
        self._entries.tick(entry)
        statuses, action = None, self.runner.action
        if entry.decision is not None:
            statuses, action = entry.decision.ticked.statuses, entry.decision.wanted
        self.on_tick(TickReport(entry.seen, statuses, action, entry.phase))

    def _hold(self, reason: str) -> str:
        """Slow down on the path, then hold for good; the only way to halt. Return what is to be added to the reason."""
        with contextlib.suppress(UserError, Rejected, ControllerGone):
            if self.link.stopped() is None:
                for arm in self.link.arms:
                    self.link.halt(arm)
                self.link.wait(self.link.now() + self.limits.rest)
        with contextlib.suppress(UserError, Rejected, ControllerGone):
            return self.link.stop(reason)
        return ""

    def _finish(self, end: Halt, start: float) -> RunOutcome:
        """Log how it ended; the arms hold already, so that a log that cannot be written changes nothing."""
        with contextlib.suppress(UserError, ControllerGone):  # the clock of a dead controller stands still
            self._time = self.link.now()
        seconds = self._time - start
        outcome = RunOutcome(end.status, end.reason, end.code, seconds, self.ticks, self.overruns)
        with contextlib.suppress(OSError, ValueError):
            if self._trace:
                self.log.write("exception", text=self._trace)
            self._entries.last_motion(end)
            self._entries.end(outcome, start + seconds)
        return outcome

    @contextlib.contextmanager
    def _interruptible(self) -> Iterator[None]:
        """Ctrl-C and a request to terminate end the run at its next tick, in order, however often they come; the arms
        slow down at once."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return

        def interrupt(*_: object) -> None:
            self._interrupted = True
            self.link.interrupt()

        before = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
