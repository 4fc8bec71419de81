"""Clusters of actions that agree, in every frame that they may be relative to.

After Gustavsson et al., Combining Context Awareness and Planning to Learn Behavior Trees from Demonstration (2022): actions
of one kind on one object are clustered (DBSCAN) by where the object is in each candidate frame, and a cluster's score is
its size divided by its spread. Beyond the publication, clusters are looked for at several distances and need no majority,
and they are compared by their evidence, in which the size counts more: a few demonstrations agree better than all of them
by mere chance.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from bt_jax.lfd.dbscan import dbscan
from bt_jax.lfd.demonstration import Action, Demonstrations, Instance, Kind
from bt_jax.tasks import Task

__all__ = [
    "HAND",
    "NEEDED",
    "REACH",
    "SPREAD_FLOOR",
    "Candidate",
    "Group",
    "Observed",
    "Rows",
    "Vec3",
    "observe",
    "occurrences",
]

NEEDED = 3  # demonstrations from which a frame can be inferred
REACH = 0.2  # metres; what agrees lies closer together than this
DISTANCES = (REACH, REACH / 2, REACH / 4)  # DBSCAN's eps: how far neighbours in a cluster may be apart
SPREAD_FLOOR = 0.001  # metres; demonstrations that agree better than this agree perfectly
GOOD_SPREAD = 0.05  # metres; actions that agree within this can be told from others
AROUND = 2.0  # metres; how far apart unrelated places are
HAND = 0.02  # metres; how closely a person repeats a place, and the least motion that tells two frames apart
CLOSER = 1.2  # how many times closer together something must be without an outlier
DOUBT = 1.5  # what may be chance for another reason must agree so many times better

Rows = frozenset[int]
Vec3 = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One frame that an action may be relative to, with the cluster that the action belongs to there.

    `score` is size / spread [1/m], -inf where the action is alone; `spread` is the largest distance to the mean [m].
    `leaves`: the frame is a box that one of the demonstrations moves later; `mixed`: what one demonstration does first
    with the object, another does later.
    """

    frame: str
    score: float
    members: tuple[Instance, ...]
    mean: Vec3
    spread: float
    leaves: bool = False
    mixed: bool = False

    @property
    def size(self) -> int:
        return len(self.members)

    @property
    def good(self) -> bool:
        """Whether the members can be told from other actions by this frame."""
        return self.score > -math.inf and self.spread <= GOOD_SPREAD

    @property
    def evidence(self) -> float:
        """The logarithm of how unlikely it is that so many are this close to the first of them by chance.

        Unrelated places are `AROUND` apart. Agreeing more closely than a hand places things adds little; a cluster that is
        `mixed`, or whose frame `leaves`, must agree better to say as much.
        """
        if self.score == -math.inf:
            return 0.0
        spread = math.hypot(self.spread, HAND) * DOUBT ** (self.leaves + self.mixed)
        return round((self.size - 1) * math.log(AROUND / spread), 6)

    @property
    def merit(self) -> tuple[float, float]:
        """What candidates are compared by; the greatest is the best."""
        return self.evidence, self.score


@dataclasses.dataclass(frozen=True)
class Observed:
    """An action with the object that it handles, and the pick that took that. `object` is what a leaf calls it: its part, if
    it is an instance of one, and nobody has said that it is meant itself."""

    instance: Instance
    action: Action
    thing: str
    object: str
    pick: Action

    def handled(self, frame: str) -> Float[np.ndarray, "3"]:
        """Return where the object is, in a frame [m]; its part stands for its own."""
        return self.action.handled(self.thing if frame == self.object else frame)

    def turn(self, frame: str) -> float:
        """Return how the object is turned about the vertical of a frame, degrees; NaN if its own frame was not recorded."""
        return self.action.turn(self.thing, frame) if self.thing in self.action.poses else math.nan

    def turn_before(self, frame: str) -> float:
        """Return how it was turned when it was picked."""
        return self.pick.turn(self.thing, frame) if self.thing in self.pick.poses else math.nan


def observe(demonstrations: Demonstrations, task: Task) -> list[Observed]:
    """Return all actions of a set of demonstrations."""
    itself = demonstrations.corrections.itself
    part_of = {thing.name: "" if itself.get(thing.name) else thing.part for thing in task.objects}
    found = []
    for d, one in enumerate(demonstrations):
        pick = one.actions[0]
        for i, (action, thing) in enumerate(zip(one.actions, one.things(demonstrations.frames), strict=True)):
            pick = action if action.kind == "pick" else pick
            found.append(Observed(Instance(d, i), action, thing, part_of.get(thing) or thing, pick))
    return found


@dataclasses.dataclass(frozen=True)
class Group:
    """All n actions of one kind on one object, and the `frames` that they may be relative to, the first preferred.

    `picked` is what each pick of the demonstrations takes. Rows count the actions.
    """

    observed: tuple[Observed, ...]
    frames: tuple[str, ...]
    picked: Mapping[Instance, str]

    @property
    def kind(self) -> Kind:
        return self.observed[0].action.kind

    @property
    def object(self) -> str:
        return self.observed[0].object

    @property
    def everything(self) -> Rows:
        return frozenset(range(len(self.observed)))

    @functools.cached_property
    def positions(self) -> dict[str, Float[np.ndarray, "n 3"]]:
        """Where the object is in each frame [m]."""
        return {frame: np.array([one.handled(frame) for one in self.observed]) for frame in self.frames}

    @functools.cached_property
    def clusters(self) -> dict[str, dict[Rows, Candidate]]:
        """The clusters in each frame, at all distances, with and without what lies apart in them: something else may be near
        by chance."""
        found = {}
        for frame, points in self.positions.items():
            labels = [dbscan(points, eps, NEEDED) for eps in DISTANCES]
            rows = [np.flatnonzero(one == label) for one in labels for label in range(one.max() + 1)]
            whole = [part for one in rows for part in _without_outliers(points, one)]
            found[frame] = {one: self.candidate(frame, one) for one in dict.fromkeys(whole)}
        return found

    def candidate(self, frame: str, rows: Rows) -> Candidate:
        """Return what is to be said of rows in a frame."""
        points = self.positions[frame][sorted(rows)]
        mean = points.mean(axis=0)
        spread = float(np.linalg.norm(points - mean, axis=1).max())
        score = float(f"{len(rows) / max(spread, SPREAD_FLOOR):.6g}") if len(rows) > 1 else -math.inf
        members = tuple(self.observed[row].instance for row in sorted(rows))
        leaves = any(self._leaves(frame, instance) for instance in members)
        turns: dict[int, set[int]] = {}
        for row in rows:
            turns.setdefault(self.observed[row].instance.demonstration, set()).add(self._turns[row])
        mixed = len(set(map(frozenset, turns.values()))) > 1
        return Candidate(frame, score, members, tuple(mean.round(4).tolist()), spread, leaves, mixed)

    def demonstrations(self, rows: Iterable[int]) -> set[int]:
        """Return from which demonstrations rows are."""
        return {self.observed[row].instance.demonstration for row in rows}

    def compared(self, row: int, rows: Rows, chosen: str) -> tuple[Candidate, ...]:
        """Return what speaks for each frame of an action, the chosen one's first and then the best: the cluster with the
        same `rows`, or else the best that the action belongs to."""
        found = []
        for frame, clusters in self.clusters.items():
            around = [one for own, one in clusters.items() if row in own]
            if rows in clusters:
                found.append(clusters[rows])
            elif frame == chosen or not around:
                found.append(self.candidate(frame, rows if frame == chosen else frozenset([row])))
            else:
                found.append(max(around, key=lambda one: one.merit))
        return tuple(sorted(found, key=lambda one: (one.frame == chosen, one.merit), reverse=True))

    def still(self, a: str, b: str, rows: Rows) -> bool:
        """Return whether two frames moved less relative to each other between rows than a hand does."""
        actions = [self.observed[row].action for row in sorted(rows)]
        return all(
            np.linalg.norm(np.ptp([action.origin(one, other) for action in actions], axis=0)) < HAND
            for one, other in ((a, b), (b, a))
        )

    @functools.cached_property
    def _turns(self) -> list[int]:
        """How many actions of its demonstration come before each."""
        return occurrences([one.instance for one in self.observed], [0] * len(self.observed))

    def _leaves(self, frame: str, instance: Instance) -> bool:
        """Return whether a demonstration moves a frame after an instance."""
        return any(
            thing == frame and other.demonstration == instance.demonstration and other.index > instance.index
            for other, thing in self.picked.items()
        )


def _without_outliers(points: Float[np.ndarray, "n 3"], rows: Int[np.ndarray, " k"]) -> Iterator[Rows]:
    """Yield rows, and what is left of them without those furthest from the mean, wherever that is closer together."""
    least = math.inf
    while len(rows) >= NEEDED:
        away = np.linalg.norm(points[rows] - points[rows].mean(axis=0), axis=1)
        if away.max() < least:
            yield frozenset(rows.tolist())
            least = away.max() / CLOSER
        rows = np.delete(rows, away.argmax())


def occurrences(instances: Sequence[Instance], keys: Sequence[Hashable]) -> list[int]:
    """Return for each action how many of its demonstration with the same key come before it."""
    counts: Counter[tuple[int, Hashable]] = Counter()
    found = []
    for instance, key in zip(instances, keys, strict=True):
        found.append(counts[instance.demonstration, key])
        counts[instance.demonstration, key] += 1
    return found
