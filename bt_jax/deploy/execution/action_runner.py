"""What the skills are doing now, for how long, and how often each action has failed.

A skill is one attempt at an action: it begins, moves, and succeeds or fails, while the tree is ticked on. Between attempts
the arms may look: they get out of the camera's way.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from bt_jax.behaviors import Behavior
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.execution.statuses import Context, Statuses
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task

__all__ = ["ActionRunner", "Skills"]


@runtime_checkable
class Skills(Protocol):
    """How actions are carried out; one at a time, never waiting."""

    reason: str  # why the last attempt failed
    fault: str  # the name in `tasks.faults.FAULTS` of what went wrong with it, "" for anything else

    @property
    def committed(self) -> bool:
        """Is it in a phase that must not be broken off?"""

    def start(self, action: Behavior, seen: Observation) -> None:
        """Begin an attempt; a plan that cannot be made is a FAILURE of the next `poll`."""

    def look(self) -> None:
        """Begin to take the arms out of the camera's way."""

    def poll(self, seen: Observation) -> Status:
        """Continue what was begun; return RUNNING until it has succeeded or failed."""

    def cancel(self) -> None:
        """Bring the arms smoothly to rest; what was begun is over."""

    def reachable(self, name: str, seen: Observation) -> bool:
        """Could an arm grasp this box at its pose?"""


class ActionRunner:
    """Begins, drives on and ends what the skills do; one thing at a time. In a dry run, plans are made as far as
    to an attempt's first motion, which may be that of the other arm, home."""

    def __init__(self, skills: Skills, link: RobotLink, log: Log, limits: Limits, *, dry: bool) -> None:
        self.skills, self.link, self.log, self.limits, self.dry = skills, link, log, limits, dry
        self.action: Behavior | None = None  # that is attempted
        self.looking = False
        self.looked: float | None = None  # when the arms were out of the way last
        self.rest_at = 0.0  # nothing is begun before
        self.failures: dict[Behavior, int] = {}
        self.broken_off: dict[Behavior, int] = {}  # since something was achieved last
        self.reasons: dict[Behavior, str] = {}  # why an action failed or was broken off last
        self._achieved: set[frozenset[Behavior]] = set()  # conditions that were known to hold at one moment
        self._began = 0.0
        self._planned: set[Behavior] = set()

    def poll(self, seen: Observation, now: float) -> None:
        """Continue the skill, and take note of its end."""
        if self.action is None and not self.looking:
            return
        status = self.skills.poll(seen)
        limit = self.limits.action
        if status == Status.RUNNING and now - self._began <= limit:
            return
        if status == Status.RUNNING:
            self.cancel(now, f"took longer than {limit:g} s")
        elif self.action is not None:
            failed = status == Status.FAILURE
            self._end(status.name, self.skills.reason if failed else "", self.skills.fault if failed else "")
            self.rest_at = now + self.limits.settle
        else:
            if status == Status.FAILURE:
                self.log.write("action", time=now, action="look", event="FAILURE", reason=self.skills.reason)
            self.looking, self.looked = False, now

    def start(self, action: Behavior, seen: Observation, now: float) -> str:
        """Begin an attempt; return what is being done, in a word."""
        if self.dry:
            if action not in self._planned:
                self._planned.add(action)
                self.skills.start(action, seen)
                status = self.skills.poll(seen)
                reason = "as far as to its first motion" if status == Status.RUNNING else self.skills.reason
                self.log.write("action", time=now, action=str(action), event="planned", reason=reason)
                if status != Status.FAILURE:
                    self.skills.cancel()
            return f"would start {action}"
        self.action, self._began = action, now
        self.log.write("action", time=now, action=str(action), event="start", reason="")
        self.skills.start(action, seen)
        return "starting"

    def look(self, now: float) -> None:
        """Begin to take the arms out of the camera's way."""
        if self.dry:
            return
        self.looking, self._began = True, now
        self.skills.look()

    def cancel(self, now: float, reason: str, *, done: bool = False) -> None:
        """Break off whatever is being done. `done`: what it was begun for is there already, so that it counts as carried
        out."""
        self.skills.cancel()
        if self.action is not None:
            late = now - self._began > self.limits.action
            self._end("DONE" if done else "TIMEOUT" if late else "CANCELLED", reason)
        self.looking = False
        self.rest_at = now + self.limits.rest

    def exhausted(self, most: int) -> frozenset[Behavior]:
        """Return the actions that were tried too often."""
        return frozenset(action for action, count in self.failures.items() if count >= most)

    def forgive(self, task: Task, seen: Observation) -> None:
        """Forget the failures of an action whose effect is there."""
        statuses = Statuses(task, seen, Context())
        for action in list(self.failures):
            if all(statuses.holds(post) for post in action.postconditions):
                del self.failures[action]

    def achieved(self, conditions: frozenset[Behavior]) -> None:
        """Take note of the conditions that hold; where they never did so together before, attempts count afresh."""
        if conditions not in self._achieved:
            self._achieved.add(conditions)
            self.broken_off.clear()

    def repeated(self, most: int) -> str:
        """Return which action was broken off too often since something was achieved last, "" if none was."""
        for action, count in self.broken_off.items():
            if count >= most:
                return f"{action} was broken off {count} times: {self.reasons[action]}"
        return ""

    def _end(self, event: str, reason: str, fault: str = "") -> None:
        """End the attempt; it counts as failed until the tree finds its action done."""
        assert self.action is not None
        if event != "DONE":
            if reason:
                self.reasons[self.action] = reason
            counts = self.broken_off if event == "CANCELLED" else self.failures
            counts[self.action] = counts.get(self.action, 0) + 1
        name, now = str(self.action), self.link.now()
        self.log.write("action", time=now, action=name, event=event, reason=reason, fault=fault)
        self.action = None
