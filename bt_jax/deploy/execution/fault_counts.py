"""How often what went wrong in runs, counted from their logs: what `tasks.faults.Faults` has probabilities and spreads for.

A tick of the simulation, which runs one command, stands for an attempt on the robot: what happens behind ticks is counted
per attempt's time. Only what the robot knew is used, so that logs of the twin are read as those of a real cell.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from typing import Any

from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, parse_behavior
from bt_jax.behaviors.geometry import is_upright, turn_error
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.settings import Limits, MotionSettings
from bt_jax.deploy.planning.pose_geometry import distance_between, plain
from bt_jax.tasks import Task

__all__ = ["FaultCounts", "count_faults"]

COMMANDS = ("open_gripper", "close_gripper", "pick", "place")
SEEN_AGAIN = 1.0  # s after an attempt from which on a measured pose owes nothing to images before its end
ELSEWHERE = MotionSettings().aside  # m from where it was at which an object was moved


@dataclasses.dataclass(frozen=True)
class FaultCounts:
    """What was counted in some logs; `+` adds those of others. Attempts are those that were carried out: broken off by
    nothing but a fault. Times are seconds."""

    attempts: int = 0
    picks: int = 0
    places: int = 0
    jams: int = 0
    slips: int = 0
    drops: int = 0
    errors: tuple[tuple[float, float], ...] = ()  # of what stayed near its place: along x and y of its frame, m
    turns: tuple[float, ...] = ()  # the same about the vertical, degrees
    strays: int = 0  # objects that did not stay near their places
    moved: int = 0
    hidden: tuple[float, ...] = ()  # how long something was out of sight that was then where it had been
    taken: tuple[float, ...] = ()  # how long something was out of sight that was then elsewhere
    attempting: float = 0.0  # all attempts together, with what the camera then has to see
    running: float = 0.0

    def __add__(self, other: FaultCounts) -> FaultCounts:
        sums = {f.name: getattr(self, f.name) + getattr(other, f.name) for f in dataclasses.fields(self)}
        return FaultCounts(**sums)

    @property
    def tick(self) -> float:
        """The seconds that stand for a tick. Raise ZeroDivisionError without attempts."""
        return self.attempting / self.attempts

    @property
    def ticks(self) -> int:
        """The ticks after which nothing was out of sight, so that something could happen."""
        return max(1, round((self.running - sum(self.hidden) - sum(self.taken)) / self.tick))


def count_faults(task: Task, entries: Iterable[Mapping[str, Any]]) -> FaultCounts:
    """Return what went wrong in a run, from the lines of its log. Raise UserError for a log that does not say which fault
    ended an attempt, as those before faults do."""
    counter = _Counter(task)
    for entry in entries:
        if entry["kind"] == "action":
            counter.take_action(entry)
        elif entry["kind"] == "tick":
            counter.take_tick(Observation.from_dict(entry["seen"]), entry["context"]["attempt"])
    return counter.counts()


@dataclasses.dataclass
class _Place:
    """What was put somewhere, and how far off it is as it was seen last."""

    action: Behavior
    ended: float
    error: tuple[float, float] | None = None
    turn: float | None = None


class _Counter:
    def __init__(self, task: Task) -> None:
        self._task = task
        self._began: float | None = None
        self._times: list[float] = []  # of the first and the last tick
        self._sums = FaultCounts()
        self._rest: dict[str, RigidTransform] = {}  # where each object was seen that nobody has touched since
        self._lost: dict[str, float] = {}  # object -> since when it is out of sight
        self._free: dict[str, float] = {}  # object -> when an attempt with it ended
        self._placed: dict[str, _Place] = {}
        self._held: str | None = None

    def take_action(self, entry: Mapping[str, Any]) -> None:
        """Take in the begin or the end of an attempt."""
        action, time = entry["action"], entry["time"]
        if entry["event"] == "start":
            self._began = time
        if entry["event"] in ("start", "planned") or self._began is None or not action.startswith(COMMANDS):
            return
        if "fault" not in entry:
            raise UserError(
                "it does not say which fault ended an attempt, since an older version wrote it; leave it out"
            )
        behavior, fault, began = parse_behavior(action), entry["fault"], self._began
        self._began = None
        self._free.update(dict.fromkeys(self._meant(behavior), time))
        if entry["event"] not in ("SUCCESS", "DONE") and not fault:
            return
        self._sums += FaultCounts(
            attempts=1,
            picks=int(behavior.name == "pick"),
            places=int(behavior.name == "place"),
            jams=int(fault == "jam"),
            slips=int(fault == "slip"),
            drops=int(fault == "drop"),
            attempting=time - began + Limits().settle,
        )
        if behavior.name == "place" and entry["event"] == "SUCCESS" and self._held is not None:
            self._placed[self._held] = _Place(behavior, time)

    def take_tick(self, seen: Observation, attempt: str | None) -> None:
        """Take in what was known at a tick."""
        self._times = [self._times[0] if self._times else seen.time, seen.time]
        busy = set() if attempt is None else self._meant(parse_behavior(attempt))
        if seen.holding is not None:
            busy.add(seen.holding)
            self._held = seen.holding
        for name in busy:
            self._conclude(name)
            self._rest.pop(name, None)
            self._lost.pop(name, None)
            self._free[name] = seen.time
        for name in self._task.object_names:
            if name in busy:
                continue
            if name in seen.missing and name in self._rest:
                self._lost.setdefault(name, seen.time)
            elif (
                name in seen.poses
                and seen.measured.get(name, -math.inf) >= self._free.get(name, -math.inf) + SEEN_AGAIN
            ):
                self._see(name, seen)

    def counts(self) -> FaultCounts:
        """Return what was counted. What is out of sight in the end was out of sight until then."""
        for name in list(self._placed):
            self._conclude(name)
        end = self._times[-1] if self._times else 0.0
        lost = tuple(end - since for since in self._lost.values())
        running = end - self._times[0] if self._times else 0.0
        return self._sums + FaultCounts(hidden=lost, running=running)

    def _see(self, name: str, seen: Observation) -> None:
        pose, rest = seen.poses[name], self._rest.get(name)
        since = self._lost.pop(name, None)
        gone = None if since is None else seen.time - since
        if rest is not None and distance_between(pose, rest) > ELSEWHERE:
            self._conclude(name)
            self._sums += FaultCounts(moved=1) if gone is None else FaultCounts(taken=(gone,))
        elif gone is not None:
            self._sums += FaultCounts(hidden=(gone,))
        self._rest[name] = pose
        if (place := self._placed.get(name)) is not None and place.error is None:
            self._measure(place, name, seen)

    def _measure(self, place: _Place, name: str, seen: Observation) -> None:
        """Note how far from its place an object is that was put there."""
        frame = seen.poses.get(str(place.action.frame))
        if place.action.frame == self._task.robot_frame:
            frame = RigidTransform.identity()
        if frame is None or place.action.position is None:
            return
        thing, pose = self._task.thing(name), seen.poses[name]
        x, y, _ = frame.inv().apply(pose.translation) - place.action.position
        place.error = (float(x), float(y))
        if is_upright(thing, plain(pose)) and (place.action.turn is not None or thing.is_cube):
            place.turn = math.degrees(turn_error(thing, plain(pose), plain(frame), place.action.turn or 0.0))

    def _conclude(self, name: str) -> None:
        """Count an object that was put somewhere, if it was seen there."""
        place = self._placed.pop(name, None)
        if place is None or place.error is None:
            return
        if math.hypot(*place.error) > self._task.thing(name).edge / 2:
            self._sums += FaultCounts(strays=1)
            return
        turns = () if place.turn is None else (place.turn,)
        self._sums += FaultCounts(errors=(place.error,), turns=turns)

    def _meant(self, action: Behavior) -> set[str]:
        """Return the objects that an attempt at an action may move."""
        return set() if action.object is None else set(self._task.instances[action.object])
