"""Inference of reference frames: an action is relative to the frame in which the demonstrations agree best.

The method of Gustavsson et al., Combining Context Awareness and Planning to Learn Behavior Trees from Demonstration (2022).
Actions of one type on one object are clustered in every candidate frame; a cluster is the better the more demonstrations
it holds and the less they differ. Beyond the publication, the number counts first among clusters that agree well, since some
of the demonstrations agree better than all of them by mere chance. Of equally many, one that mixes what is done first with
an object and what is done later, or whose frame is a box that is moved away later, is the last to be taken. Everything that
was weighed is kept, to be shown.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Collection, Hashable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from bt_jax.behaviors import Behavior
from bt_jax.lfd.dbscan import dbscan
from bt_jax.lfd.demonstration import Action, Demonstrations, Frames, Instance, Kind

__all__ = ["NEEDED", "SAME_PLACE", "SPREAD_FLOOR", "Candidate", "Inference", "infer", "rounded"]

NEEDED = 3  # demonstrations from which a frame can be inferred
EPS = 0.2  # DBSCAN: how far neighbours in a cluster may be apart, metres
SPREAD_FLOOR = 0.001  # metres; demonstrations that agree better than this agree perfectly
GOOD_SPREAD = 0.05  # metres; actions that agree within this may be relative to a frame
SAME_PLACE = 0.03  # metres; with too few demonstrations, what lies closer together counts as one place

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
        """Whether the action may be relative to this frame, if no other is better."""
        return self.score > -math.inf and self.spread <= GOOD_SPREAD

    @property
    def merit(self) -> tuple:
        """What candidates are compared by; the greatest is the best."""
        demonstrations = len({instance.demonstration for instance in self.members})
        if not self.good:
            return (False, 0, True, True, self.score)
        return (True, demonstrations, not self.mixed, not self.leaves, self.score)


@dataclasses.dataclass(frozen=True)
class Inference:
    """What several observed actions are instances of, and why.

    `position` is the target of the object's centre in `frame` [m, rounded to mm], the mean over the `instances`;
    `tolerance` the largest distance from it. `candidates` are the frames as seen by the first instance, the best first;
    `reason` is a sentence; `chosen`: a person has said that it is this frame.
    """

    kind: Kind
    object: str
    frame: str
    position: Vec3
    tolerance: float
    instances: tuple[Instance, ...]
    candidates: tuple[Candidate, ...]
    reason: str
    chosen: bool = False

    @property
    def behavior(self) -> Behavior:
        if self.kind == "pick":
            return Behavior("pick", (self.object,))
        return Behavior("place", (self.object, self.position, self.frame))


@dataclasses.dataclass(frozen=True)
class _Observed:
    """An action with the object that it handles."""

    instance: Instance
    action: Action
    object: str


def infer(demonstrations: Demonstrations, *, movable: Collection[str]) -> tuple[Inference, ...]:
    """Return the distinct actions of a set of demonstrations, in the order in which they are first seen.

    Where two frames fit equally well, one of a `movable` object is preferred to a fixture's, since that object may stand
    elsewhere next time, and either to the robot's.
    """
    frames = demonstrations.frames
    order = sorted(frames.names, key=lambda name: (name == frames.robot, name not in movable))
    frames = dataclasses.replace(frames, names=tuple(order))
    groups: dict[tuple[str, str], list[_Observed]] = {}
    for observed in _observed(demonstrations):
        groups.setdefault((observed.action.kind, observed.object), []).append(observed)
    count = len(demonstrations)
    picked = {one.instance: one.object for group in groups.values() for one in group if one.action.kind == "pick"}
    found = [inference for group in groups.values() for inference in _infer_group(group, frames, count, picked)]
    return tuple(sorted(found, key=lambda inference: min((m.index, m.demonstration) for m in inference.instances)))


def _observed(demonstrations: Demonstrations) -> list[_Observed]:
    found = []
    for d, demonstration in enumerate(demonstrations):
        held = ""
        for i, action in enumerate(demonstration.actions):
            held = action.nearest(demonstrations.frames.objects) if action.kind == "pick" else held
            found.append(_Observed(Instance(d, i), action, held))
    return found


def _infer_group(
    group: Sequence[_Observed], frames: Frames, count: int, picked: Mapping[Instance, str]
) -> list[Inference]:
    """Split actions of one type on one object into those with the same goal; `picked` is what all demonstrations pick."""
    first = group[0]
    kind, thing = first.action.kind, first.object
    names = [frame for frame in frames.names if kind == "pick" or frame != thing]
    positions = {frame: np.array([one.action.handled(frame) for one in group]) for frame in names}
    instances = [one.instance for one in group]
    whose = [instance.demonstration for instance in instances]
    if count < NEEDED:
        frame = thing if kind == "pick" else frames.default
        why = (
            "a pick is relative to its object"
            if kind == "pick"
            else f"{count} of {NEEDED} demonstrations needed to infer a frame, so it is {frame}"
        )
        labels = _labels(positions[frame], whose, SAME_PLACE, 1)
        nth = _occurrences(instances, labels.tolist())
        members: dict[tuple, list[int]] = {}
        for row, key in enumerate(zip(labels.tolist(), nth, strict=True)):
            members.setdefault(key, []).append(row)
        return [
            _inference(kind, thing, frame, positions, instances, np.array(rows), (), why) for rows in members.values()
        ]

    min_samples = NEEDED if count <= NEEDED else count // 2 + 1
    clusters = {frame: _labels(positions[frame], whose, EPS, min_samples) for frame in names}
    ranked = [_ranked(row, clusters, positions, instances, frames, picked) for row in range(len(group))]
    if kind == "pick":
        ranked = [tuple(sorted(own, key=lambda candidate: candidate.frame != thing)) for own in ranked]
    found = []
    single = [one for one, own in zip(group, ranked, strict=True) if own[0].score == -math.inf]
    again = kind == "place" and single and min_samples > NEEDED
    if again:  # no majority agrees with these, but fewer may: those of another subtask
        found += _infer_group(single, frames, NEEDED, picked)
    for rows in _meanings(instances, ranked, clusters, kind):
        own = ranked[rows[0]]
        if again and own[0].score == -math.inf:
            continue
        alone = own[0].score == -math.inf
        frame = thing if kind == "pick" else frames.default if alone else own[0].frame
        why = _reason(kind, frame, own, alone, min_samples)
        found.append(_inference(kind, thing, frame, positions, instances, np.array(rows), own, why))
    return found


def _meanings(
    instances: Sequence[Instance],
    ranked: Sequence[Sequence[Candidate]],
    clusters: dict[str, np.ndarray],
    kind: Kind,
) -> list[list[int]]:
    """Return the rows of actions with the same goal: those of one cluster in their best frame.

    If a demonstration has several of them, they are separated by the cluster in the second-best frame, if those are good and
    separate all of them, and otherwise by their order.
    """
    together: dict[tuple, list[int]] = {}
    for row, own in enumerate(ranked):
        alone = own[0].score == -math.inf and kind == "place"
        together.setdefault(("", row) if alone else (own[0].frame, int(clusters[own[0].frame][row])), []).append(row)
    found: dict[tuple, list[int]] = {}
    for meaning, rows in together.items():
        observed = [instances[row] for row in rows]
        split = [_second_cluster(row, ranked[row], clusters) for row in rows]
        if not any(_occurrences(observed, [0] * len(rows))) or any(_occurrences(observed, split)):
            split = [("", 0)] * len(rows)
        for row, part, nth in zip(rows, split, _occurrences(observed, split), strict=True):
            found.setdefault((meaning, part, nth), []).append(row)
    return list(found.values())


def _second_cluster(row: int, own: Sequence[Candidate], clusters: dict[str, np.ndarray]) -> tuple[str, int]:
    """Return the frame and the cluster of an action in its second-best frame, ("", 0) if that says nothing."""
    good = len(own) > 1 and own[1].good
    return (own[1].frame, int(clusters[own[1].frame][row])) if good else ("", 0)


def _occurrences(instances: Sequence[Instance], keys: Sequence[Hashable]) -> list[int]:
    """Return for each action how many of its demonstration with the same key come before it."""
    counts: Counter[tuple[int, Hashable]] = Counter()
    found = []
    for instance, key in zip(instances, keys, strict=True):
        found.append(counts[instance.demonstration, key])
        counts[instance.demonstration, key] += 1
    return found


def _labels(
    points: Float[np.ndarray, "n 3"], demonstrations: Sequence[int], eps: float, min_samples: int
) -> np.ndarray:
    """Return the cluster of each point, -1 for none. One that holds several points of a demonstration is split by a
    smaller `eps` if possible: what does not belong to it was near by chance."""
    labels = dbscan(points, eps, min_samples)
    whose = np.asarray(demonstrations)
    for label in range(labels.max() + 1):
        rows = np.flatnonzero(labels == label)
        if len(set(whose[rows].tolist())) == len(rows) or eps / 2 < SAME_PLACE:
            continue
        parts = _labels(points[rows], whose[rows].tolist(), eps / 2, min_samples)
        if parts.max() >= 0:
            labels[rows] = np.where(parts < 0, -1, np.where(parts == 0, label, labels.max() + parts))
    return labels


def _ranked(
    row: int,
    clusters: dict[str, np.ndarray],
    positions: dict[str, np.ndarray],
    instances: Sequence[Instance],
    frames: Frames,
    picked: Mapping[Instance, str],
) -> tuple[Candidate, ...]:
    """Return the candidate frames of one action, the best first; equals in the order of the frames."""
    nth = _occurrences(instances, [0] * len(instances))
    found = []
    for frame, labels in clusters.items():
        rows = np.flatnonzero(labels == labels[row]) if labels[row] >= 0 else np.array([row])
        points = positions[frame][rows]
        mean = points.mean(axis=0)
        spread = float(np.linalg.norm(points - mean, axis=1).max())
        score = len(rows) / max(spread, SPREAD_FLOOR) if len(rows) > 1 else -math.inf
        members = tuple(instances[i] for i in rows)
        leaves = any(_leaves(frame, instance, picked) for instance in members)
        mixed = len({nth[i] for i in rows}) > 1
        score = float(f"{score:.6g}")
        found.append(Candidate(frame, score, members, tuple(mean.round(4).tolist()), spread, leaves, mixed))
    found.sort(key=lambda one: frames.names.index(one.frame))
    return tuple(sorted(found, key=lambda one: one.merit, reverse=True))


def _leaves(frame: str, instance: Instance, picked: Mapping[Instance, str]) -> bool:
    """Return whether a demonstration moves a frame after an instance."""
    return any(
        thing == frame and other.demonstration == instance.demonstration and other.index > instance.index
        for other, thing in picked.items()
    )


def _inference(
    kind: Kind,
    thing: str,
    frame: str,
    positions: dict[str, np.ndarray],
    instances: Sequence[Instance],
    rows: np.ndarray,
    candidates: Sequence[Candidate],
    reason: str,
) -> Inference:
    points = positions[frame][rows]
    mean = points.mean(axis=0)
    return Inference(
        kind=kind,
        object=thing,
        frame=frame,
        position=rounded(mean),
        tolerance=float(np.linalg.norm(points - mean, axis=1).max()),
        instances=tuple(instances[row] for row in rows),
        candidates=tuple(candidates),
        reason=reason,
    )


def rounded(position: Float[np.ndarray, "3"]) -> Vec3:
    """Return a position [m], rounded to mm."""
    x, y, z = (round(float(x), 3) + 0.0 for x in position)
    return x, y, z


def _reason(kind: Kind, frame: str, own: Sequence[Candidate], alone: bool, min_samples: int) -> str:
    if kind == "pick":
        return "a pick is relative to its object"
    if alone:
        return f"no frame has {min_samples} demonstrations that agree within {EPS} m, so it is {frame}"
    best, second = own[0], own[1] if len(own) > 1 else None
    agree = f"{best.size} agree within {1000 * max(best.spread, SPREAD_FLOOR):.0f} mm in {frame}"
    if second is None:
        return f"{agree}, the only frame"
    if second.merit == best.merit:
        return f"{agree}; {second.frame} fits as well"
    if second.score == -math.inf:
        return f"{agree}, and in no other frame"
    moved = ", which is moved later" if second.leaves else ""
    return f"{agree}, {second.size} in {second.frame} within {1000 * max(second.spread, SPREAD_FLOOR):.0f} mm{moved}"
