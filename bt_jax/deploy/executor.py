"""Ticks a tree on the robot, starts and ends the skills that it asks for, and knows when to stop.

A skill is one attempt at an action: it begins, moves, and succeeds or fails, while the tree is ticked on. As soon as the
tree wants something else, the attempt is broken off smoothly, except in its committed phases (fingers closing, a box being
set down). What cannot be decided, because something is not seen, neither begins nor breaks off an action: the arms get out
of the camera's way first.
"""

from __future__ import annotations

import contextlib
import dataclasses
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from typing import Any, Protocol, runtime_checkable

import numpy as np

from bt_jax.behaviors import Behavior, Tree, expand
from bt_jax.deploy.controller import ControllerGone
from bt_jax.deploy.link import RobotLink
from bt_jax.deploy.log import FORMAT, Log, versions
from bt_jax.deploy.observation import Observation
from bt_jax.deploy.program import Program
from bt_jax.deploy.safety import Rejected
from bt_jax.deploy.statuses import Context, Statuses, seen_subgoals
from bt_jax.encoding.interpret import TreeTick, tick_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.text import one_line
from bt_jax.encoding.walk import prefix
from bt_jax.errors import UserError

__all__ = ["Executor", "Exit", "Limits", "Observation", "Outcome", "Shown", "Skills", "decide"]

MOVED = 0.005  # metres or radians by which a box must move before it is asked again whether it can be reached
SETTLED = 0.35  # seconds that arms take to come to rest
RECORD_EVERY = 5  # of the link's cycles, one is logged; all of the last ones before a stop


class Exit:
    """What the process tells its caller."""

    DONE, FAILED, USER_ERROR, STOPPED, INTERRUPTED = 0, 1, 2, 3, 130


@runtime_checkable
class Skills(Protocol):
    """How actions are carried out; one at a time, never waiting."""

    committed: bool  # in a phase that must not be broken off
    reason: str  # why the last attempt failed

    def start(self, action: Behavior, seen: Observation) -> None:
        """Begins an attempt; a plan that cannot be made is a FAILURE of the next `poll`."""

    def look(self) -> None:
        """Begins to take the arms out of the camera's way."""

    def poll(self, seen: Observation) -> Status:
        """Drives what was begun on; RUNNING until it has succeeded or failed."""

    def cancel(self) -> None:
        """Brings the arms smoothly to rest; what was begun is over."""

    def reachable(self, name: str, seen: Observation) -> bool:
        """Could an arm grasp this box where it is?"""


@dataclasses.dataclass(frozen=True)
class Limits:
    """Seconds."""

    tick: float = 0.1  # from tick to tick
    run: float = 600.0  # the whole run
    action: float = 60.0  # one attempt
    look: float = 3.0  # for what is not seen to be seen once the arms are out of the way; then it counts as absent
    settle: float = 0.5  # for the camera to see what an attempt has changed
    patience: float = 10.0  # for which the tree may fail before the run has failed
    success: float = 1.0  # for which it must succeed
    image: float = 1.0  # the newest image may be old


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a run ended; `status` is RUNNING where it was stopped."""

    status: Status
    reason: str
    exit_code: int
    seconds: float
    ticks: int
    overruns: int  # ticks that took longer than they may


@dataclasses.dataclass(frozen=True)
class Shown:
    """One tick, for displays; `statuses` of the nodes of the expanded tree, None where the tree was not ticked."""

    seen: Observation
    statuses: tuple[Status | None, ...] | None
    action: Behavior | None
    phase: str


class _Halt(Exception):
    """The run is over: `reason`, exit code."""

    def __init__(self, reason: str, code: int, status: Status = Status.RUNNING) -> None:
        super().__init__(reason)
        self.reason, self.code, self.status = reason, code, status


def decide(program: Program, tree: Tree, seen: Observation, context: Context) -> tuple[TreeTick, list[Behavior]]:
    """One tick of an expanded tree, and the conditions that were asked in it and cannot be decided."""
    statuses = Statuses(program.task, seen, context)
    return tick_tree(tree, statuses), statuses.undecided


class Executor:
    """Runs a program on a robot. `observe` gives what is known now; `on_tick` is told of every tick."""

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
        on_tick: Callable[[Shown], None] | None = None,
    ) -> None:
        self.program, self.tree = program, expand(program.tree)
        self.nodes = prefix(self.tree)
        self.skills, self.link, self.observe, self.log = skills, link, observe, log
        self.limits, self.settings, self.dry = limits or Limits(), settings or {}, dry
        self.on_tick = on_tick or (lambda shown: None)
        self.ticks = self.overruns = 0
        self._boxes = sorted({node.object for node in self.nodes if isinstance(node, Behavior) and node.name == "pick"})
        self._attempt: Behavior | None = None
        self._looking = False
        self._began = 0.0  # of what the skills are doing
        self._rest_at = 0.0  # nothing is begun before
        self._failures: dict[Behavior, int] = {}
        self._reached: frozenset[str] = frozenset()
        self._reach: dict[str, tuple[Any, bool]] = {}
        self._unknown: frozenset[Behavior] = frozenset()
        self._looked: float | None = None  # when the arms were out of the way, since `_unknown` is what it is
        self._since: tuple[Status, float] = (Status.RUNNING, 0.0)  # what the tree returns, and since when
        self._interrupted = False
        self._planned: set[Behavior] = set()

    def run(self) -> Outcome:
        """Until the tree has succeeded, or failed for good, or something stops it. The arms hold afterwards."""
        start = self.link.now()
        self._since, self._rest_at = (Status.RUNNING, start), start
        self.log.write(
            "start",
            format=FORMAT,
            time=start,
            tree=one_line(self.program.tree),
            digest=self.program.digest,
            task=self.program.task.to_dict(),
            limits=dataclasses.asdict(self.limits),
            settings=self.settings,
            dry=self.dry,
            versions=versions(),
        )
        try:
            with self._interruptible():
                while True:
                    self._step(start)
        except _Halt as halt:
            end = halt
        except KeyboardInterrupt:
            end = _Halt("interrupted", Exit.INTERRUPTED)
        except ControllerGone as gone:
            end = _Halt(f"controller: {gone}", Exit.STOPPED)
        except Exception as error:
            self.log.write("exception", text=traceback.format_exc())
            end = _Halt(f"{type(error).__name__}: {error}", Exit.STOPPED)
        if end.code in (Exit.STOPPED, Exit.INTERRUPTED):
            self._hold(end.reason)
        return self._finish(end, start)

    def _step(self, start: float) -> None:
        """One tick and what follows from it. Raises _Halt where the run is over."""
        began = time.monotonic()
        now = self.link.now()
        self._check(now, start)
        seen = self.observe()
        if seen.time - seen.image > self.limits.image:
            raise _Halt(f"camera: no new image for {seen.time - seen.image:.1f} s", Exit.STOPPED)
        self._reached |= seen_subgoals(self.program.task, seen)
        self._poll(seen, now)
        ticked = None
        context = self._context(seen)
        if self._attempt is not None and self.skills.committed:
            phase = "committed"
        elif now < self._rest_at:
            phase = "settling"
        else:
            ticked, undecided = decide(self.program, self.tree, seen, context)
            phase = self._act(ticked, frozenset(undecided), seen, now)
        self.overruns += self.link.now() - now > self.limits.tick  # never where time is simulated: it waits for us
        self._record(seen, context, ticked, phase, time.monotonic() - began)
        self.link.wait(now + self.limits.tick)

    def _check(self, now: float, start: float) -> None:
        if self._interrupted:
            raise _Halt("interrupted", Exit.INTERRUPTED)
        reason = self.link.stopped()
        if reason is not None:
            raise _Halt(reason, Exit.STOPPED)
        if now - start > self.limits.run:
            self.skills.cancel()
            raise _Halt(f"the time is up ({self.limits.run:g} s)", Exit.FAILED)

    def _poll(self, seen: Observation, now: float) -> None:
        """Drives the skill on and takes note of its end."""
        if self._attempt is None and not self._looking:
            return
        status = self.skills.poll(seen)
        limit = self.limits.action
        if status == Status.RUNNING and now - self._began <= limit:
            return
        if status == Status.RUNNING:
            self._cancel(now, f"took longer than {limit:g} s")
        elif self._attempt is not None:
            reason = self.skills.reason if status == Status.FAILURE else ""
            self._end(status.name, reason)
            self._rest_at = now + self.limits.settle
        else:
            self._looking, self._looked = False, now

    def _context(self, seen: Observation) -> Context:
        most = self.program.task.episode.action_ticks
        return Context(
            attempt=self._attempt,
            exhausted=frozenset(action for action, count in self._failures.items() if count >= most),
            reached=self._reached,
            unreachable=frozenset(name for name in self._boxes if not self._reachable(name, seen)),
        )

    def _reachable(self, name: str, seen: Observation) -> bool:
        """As the skills say, asked again only where the box has moved."""
        pose = seen.poses.get(name)
        if pose is None or self._attempt is not None:
            return self._reach.get(name, (None, True))[1]
        before, answer = self._reach.get(name, (None, False))
        if before is not None:
            change = before.inv() * pose
            if max(np.linalg.norm(change.translation), change.rotation.magnitude()) < MOVED:
                return answer
        answer = self.skills.reachable(name, seen)
        self._reach[name] = (pose, answer)
        return answer

    def _act(self, ticked: TreeTick, undecided: frozenset[Behavior], seen: Observation, now: float) -> str:
        """Begins, goes on with or breaks off; gives what is being done in a word."""
        self._forgive(seen)
        if undecided != self._unknown:
            self._looked = self._looked if undecided < self._unknown else None
            self._unknown = undecided
        blind = bool(undecided) and (self._looked is None or now - self._looked < self.limits.look)
        wanted = None if ticked.running is None else self.nodes[ticked.running]
        if self._attempt is not None:
            if wanted == self._attempt:
                return "acting"
            if blind:
                return "acting unseen"
            self._cancel(now, f"the tree wants {wanted or ticked.status.name}")
            return "halting"
        if blind:
            self._since = (Status.RUNNING, now)
            if not self._looking and self._looked is None and not self.dry:
                self._look(now)
            return "looking"
        if wanted is not None:
            self._since = (Status.RUNNING, now)
            if self._looking:
                self._cancel(now, "seen")
                return "halting"
            return self._start(wanted, seen, now)
        self._judge(ticked.status, undecided, now)
        return "waiting"

    def _forgive(self, seen: Observation) -> None:
        """An action whose effect is there may be tried as often again."""
        statuses = Statuses(self.program.task, seen, Context())
        for action in list(self._failures):
            if all(statuses.holds(post) for post in action.postconditions):
                del self._failures[action]

    def _judge(self, status: Status, undecided: frozenset[Behavior], now: float) -> None:
        """The tree wants nothing: is the run over? Success must be seen with the arms out of the way."""
        if self._since[0] != status:
            self._since = (status, now)
            if status == Status.SUCCESS and not self._looking:
                self._look(now)
        lasted = now - self._since[1]
        if status == Status.SUCCESS and not self._looking and lasted >= self.limits.success:
            raise _Halt("the tree has succeeded", Exit.DONE, status)
        if status == Status.FAILURE and lasted >= self.limits.patience:
            unseen = sorted({name for c in undecided for name in (c.object, c.frame) if name is not None})
            why = [f"{action} failed {count} times" for action, count in self._failures.items()]
            why += [f"{name} is out of reach" for name in self._context_unreachable()]
            why += [f"one of {', '.join(unseen)} is not seen"] if unseen else []
            raise _Halt(f"the tree has failed{': ' if why else ''}{'; '.join(why)}", Exit.FAILED, status)

    def _context_unreachable(self) -> list[str]:
        return [name for name, (_, answer) in self._reach.items() if not answer]

    def _start(self, action: Behavior, seen: Observation, now: float) -> str:
        if self.dry:
            if action not in self._planned:
                self._planned.add(action)
                self.skills.start(action, seen)
                status = self.skills.poll(seen)
                self.log.write("action", time=now, action=str(action), event="planned", reason=self.skills.reason)
                if status != Status.FAILURE:
                    self.skills.cancel()
            return f"would start {action}"
        self._attempt, self._began = action, now
        self.log.write("action", time=now, action=str(action), event="start", reason="")
        self.skills.start(action, seen)
        return "starting"

    def _look(self, now: float) -> None:
        if self.dry:
            return
        self._looking, self._began = True, now
        self.skills.look()

    def _cancel(self, now: float, reason: str) -> None:
        self.skills.cancel()
        if self._attempt is not None:
            late = now - self._began > self.limits.action
            self._end("TIMEOUT" if late else "CANCELLED", reason)
        self._looking = False
        self._rest_at = now + SETTLED

    def _end(self, event: str, reason: str) -> None:
        """The attempt is over; it counts as failed until the tree finds its action done."""
        assert self._attempt is not None
        if event != "CANCELLED":
            self._failures[self._attempt] = self._failures.get(self._attempt, 0) + 1
        self.log.write("action", time=self.link.now(), action=str(self._attempt), event=event, reason=reason)
        self._attempt = None

    def _record(self, seen: Observation, context: Context, ticked: TreeTick | None, phase: str, took: float) -> None:
        self.ticks += 1
        statuses = None if ticked is None else ticked.statuses
        self.log.write(
            "tick",
            seen=seen.to_dict(),
            context={
                "attempt": None if context.attempt is None else str(context.attempt),
                "exhausted": sorted(map(str, context.exhausted)),
                "reached": sorted(context.reached),
                "unreachable": sorted(context.unreachable),
            },
            statuses=None if statuses is None else "".join("." if s is None else str(int(s)) for s in statuses),
            phase=phase,
            took=round(took, 4),
        )
        self._record_motion(RECORD_EVERY)
        action = None if ticked is None or ticked.running is None else self.nodes[ticked.running]
        self.on_tick(Shown(seen, statuses, action if ticked is not None else self._attempt, phase))

    def _record_motion(self, every: int) -> None:
        drain = getattr(self.link, "drain", None)
        if drain is not None:
            self.log.motion(self.link.arms, drain(), every=every)

    def _hold(self, reason: str) -> None:
        """The one way to halt: slow down on the path, then hold for good."""
        with contextlib.suppress(UserError, Rejected, ControllerGone):
            if self.link.stopped() is None:
                for arm in self.link.arms:
                    self.link.halt(arm)
                self.link.wait(self.link.now() + SETTLED)
        with contextlib.suppress(UserError, Rejected, ControllerGone):
            self.link.stop(reason)

    def _finish(self, end: _Halt, start: float) -> Outcome:
        with contextlib.suppress(UserError):
            self._record_motion(1 if end.code in (Exit.STOPPED, Exit.INTERRUPTED) else RECORD_EVERY)
        seconds = self.link.now() - start
        outcome = Outcome(end.status, end.reason, end.code, seconds, self.ticks, self.overruns)
        self.log.write(
            "end",
            time=start + seconds,
            **{**dataclasses.asdict(outcome), "status": end.status.name},
            counters=dataclasses.asdict(self.link.counters()),
        )
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
