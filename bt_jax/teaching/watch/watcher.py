"""From what a camera sees of the bodies to what a person did with them: which box was moved, from where to where, in which
order, and what about it is in doubt. No camera and no clock: sightings in, events out."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.pose_geometry import distance_between, is_over_kit, stands_on
from bt_jax.deploy.robot.arrays import Point
from bt_jax.tasks import Task
from bt_jax.teaching.watch.doubts import doubt_about_end, doubts_about
from bt_jax.teaching.watch.moves import Doubt, Kind, Move, Watched
from bt_jax.teaching.watch.rest import BodyTrack, Rest, WatchSettings
from bt_jax.teaching.watch.sighting import Sighting

__all__ = ["Event", "EventKind", "Watcher"]

EventKind = Literal["start", "moving", "stands", "back", "doubt", "done"]
HEIGHT = 0.3  # of its size: how exactly the foot of a box must be at the height of what it stands on
LONG = 10.0  # seconds after which a body that stays hidden does not keep the demonstration from ending


@dataclasses.dataclass(frozen=True)
class Event:
    """What is to be said at `time` [s]."""

    time: float
    kind: EventKind
    text: str
    body: str = ""


class Watcher:
    """Watch one demonstration: `update` with every sighting, then `finish`. It begins once all boxes and the kit have been
    seen at rest together."""

    def __init__(self, task: Task, settings: WatchSettings | None = None) -> None:
        self.task, self.settings = task, settings or WatchSettings()
        sizes = {box.name: box.edge for box in task.objects} | dict.fromkeys(
            task.kit_names, min(box.edge for box in task.objects)
        )
        self._tracks = {name: BodyTrack(size, self.settings) for name, size in sizes.items()}
        self._started = False
        self._moves: list[Move] = []
        self._doubts: list[Doubt] = []
        self._moving: set[str] = set()  # of which it was said
        self._time = self._changed = -math.inf

    @property
    def time(self) -> float:
        """Of the newest image [s]."""
        return self._time

    @property
    def started(self) -> bool:
        """Have all bodies been seen at rest together?"""
        return self._started

    @property
    def missing(self) -> tuple[str, ...]:
        """Which bodies are not at rest in sight."""
        return tuple(name for name, track in self._tracks.items() if track.away or not self._fresh(track))

    @property
    def moves(self) -> tuple[Move, ...]:
        """What was moved so far."""
        return tuple(self._moves)

    @property
    def over(self) -> bool:
        """Was something carried, and has nothing moved since for long enough?"""
        carried = any(move.kind == "carried" for move in self._moves)
        return carried and self._time - self._changed >= self.settings.idle

    def update(self, sighting: Sighting) -> list[Event]:
        """Take in one image, later than those before, and return what it tells."""
        self._time = sighting.time
        for name, seen in sighting.bodies.items():
            self._tracks[name].see(sighting.time, seen)
        for name in sighting.screened:
            self._tracks[name].clear = sighting.time
        events = list(self._begin() if not self._started else self._happened())
        if events or any(self._unsettled(track) for track in self._tracks.values()):
            self._changed = sighting.time
        return events

    def finish(self) -> tuple[list[Event], Watched]:
        """Return what is to be said at the end, and all that was seen."""
        events = []
        for name, track in self._tracks.items():
            track.average()
            lost = track.away or not (self._fresh(track) or self._carries(name))
            if self._started and lost:
                doubt = doubt_about_end(name, track.away, visible=self._time - track.seen < self.settings.settle)
                self._doubts.append(doubt)
                events.append(Event(self._time, "doubt", doubt.text, name))
        count = sum(move.kind == "carried" for move in self._moves)
        events.append(Event(self._time, "done", f"done: {count} move{'s' * (count != 1)}"))
        start = {name: track.rests[0] for name, track in self._tracks.items() if track.rests}
        counts: Counter[str] = Counter()
        moves = []
        for move in self._moves:
            counts[move.box] += 1
            moves.append(dataclasses.replace(move, after=self._tracks[move.box].rests[counts[move.box]]))
        return events, Watched(start if self._started else {}, tuple(moves), tuple(self._doubts))

    def _begin(self) -> Iterator[Event]:
        for track in self._tracks.values():
            found = track.candidate(self._time) if track.away else None
            if found is not None and found[2]:
                track.rests.clear()
                track.settle(found[0])
        if not self.missing:
            self._started = True
            names = ", ".join(self._tracks)
            yield Event(self._time, "start", f"start: {names} are at rest")

    def _happened(self) -> Iterator[Event]:
        for name, track in self._tracks.items():
            if track.away and name not in self._moving:
                self._moving.add(name)
                yield Event(track.left, "moving", f"{name} is moving", name)
        away = [name for name, track in self._tracks.items() if track.away]
        found = {name: one for name in away if (one := self._tracks[name].candidate(self._time)) is not None}
        for name, (rest, since, clear) in sorted(found.items(), key=lambda item: item[1][0].pose.translation[2]):
            under = self._under(name, rest.pose) if clear and self._is_free(name, rest.pose) else None
            if under is not None:
                yield from self._rested(name, rest, since, under)

    def _rested(self, name: str, rest: Rest, since: float, under: str) -> Iterator[Event]:
        track = self._tracks[name]
        sizes, turned = track.shift(rest)
        kind: Kind = "carried" if sizes >= self.settings.carried and name not in self.task.kit_names else "bumped"
        if sizes < self.settings.bumped and turned < self.settings.turned:
            kind = "returned"
        self._moves.append(Move(name, kind, track.rests[-1], rest, under, track.left, since))
        track.settle(rest)
        self._moving.discard(name)
        if kind == "returned":
            yield Event(self._time, "back", f"{name} is back where it was", name)
        elif kind == "carried":
            where = "in" if under in self.task.kit_names else "on"
            yield Event(self._time, "stands", f"{name} stands {where} {under}", name)
        for doubt in doubts_about(self._moves, self.settings.settle / 2):
            self._doubts.append(doubt)
            yield Event(self._time, "doubt", doubt.text, name)

    def _under(self, name: str, pose: RigidTransform) -> str | None:
        """Return on what a body would stand there: a box at rest, a kit or a table; None if there is nothing under it."""
        if name in self.task.kit_names:
            return self._table(pose.translation, 0.0)
        size, here = self.task.thing(name).height, pose.translation
        poses = {n: t.rest.pose for n, t in self._tracks.items() if not t.away and t.rest is not None} | {name: pose}
        for other in self.task.object_names:
            if other in poses and stands_on(self.task, name, other, poses):
                return other
        slack = HEIGHT * size
        for kit in self.task.kits:
            at = self._tracks[kit.name].rest
            if at is not None and is_over_kit(kit, at.pose, here):
                height = at.pose.inv().apply(here)[2] - kit.plate - size / 2
                if abs(height) < slack:
                    return kit.name
        return self._table(here - np.array([0.0, 0.0, size / 2]), slack)

    def _table(self, foot: Point, slack: float) -> str | None:
        """Return the table that is nearest to a foot at the height of its top."""
        tables = [
            (float(np.linalg.norm(foot[:2] - middle[:2])), table.name)
            for table in self.task.tables
            for middle in [np.subtract(table.position, self.task.robot_position)]
            if not slack or abs(foot[2] - (table.top - self.task.robot_position[2])) < slack
        ]
        return min(tables)[1] if tables else None

    def _is_free(self, name: str, pose: RigidTransform) -> bool:
        """Have hands left what is near this pose? Whatever is at rest there was seen clearly just now."""
        near = self.settings.near * self._tracks[name].size
        return all(
            other == name
            or track.away
            or track.rest is None
            or distance_between(track.rest.pose, pose) > near
            or self._time - track.clear <= self.settings.settle
            or self._time - track.clear >= self.settings.patience
            for other, track in self._tracks.items()
        )

    def _carries(self, name: str) -> bool:
        """Does another box stand on this one, so that it is where it was, even if it cannot be seen?"""
        return any(
            not track.away and track.rest is not None and self._under(other, track.rest.pose) == name
            for other, track in self._tracks.items()
            if other not in (name, *self.task.kit_names)
        )

    def _fresh(self, track: BodyTrack) -> bool:
        return self._time - max(track.seen, track.clear) <= self.settings.settle

    def _unsettled(self, track: BodyTrack) -> bool:
        """Is it away in sight, or out of sight not for long?"""
        hidden = self._time - max(track.seen, track.clear)
        return track.away or 0 < hidden < LONG
