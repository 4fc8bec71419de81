"""In which frame an action was meant: the one in which the demonstrations agree best.

The method of Gustavsson et al., Combining Context Awareness and Planning to Learn Behavior Trees from Demonstration (2022).
Actions of one type on one object are clustered in every candidate frame; a cluster is the better the more demonstrations
it holds and the less they differ. Everything that was weighed is kept, to be shown.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Sequence

import numpy as np
from jaxtyping import Float
from sklearn.cluster import DBSCAN

from bt_jax.behaviors import Behavior
from bt_jax.lfd.demonstration import Action, Demonstrations, Frames, Kind

__all__ = ["NEEDED", "Candidate", "Inference", "Moment", "infer"]

NEEDED = 3  # demonstrations from which a frame can be told
EPS = 0.2  # DBSCAN: how far neighbours in a cluster may be apart, metres
SPREAD_FLOOR = 0.001  # metres; demonstrations that agree better than this agree perfectly
SPLIT_SCORE = 20.0  # times the number of demonstrations: agreement to 50 mm in a second frame tells two actions apart
SAME_PLACE = 0.03  # metres; with too few demonstrations, what lies closer together counts as one place

Vec3 = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Moment:
    """Which action of which demonstration, both counted from 0."""

    demonstration: int
    index: int


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One frame in which an action may have been meant, with the cluster that the action belongs to there.

    `score` is size / spread [1/m], -inf where the action is alone; `spread` is the largest distance to the mean [m].
    """

    frame: str
    score: float
    members: tuple[Moment, ...]
    mean: Vec3
    spread: float

    @property
    def size(self) -> int:
        return len(self.members)


@dataclasses.dataclass(frozen=True)
class Inference:
    """What several observed actions are instances of, and why.

    `position` is the target of the object's centre in `frame` [m, rounded to mm], the mean over the `moments`;
    `tolerance` the largest distance from it. `candidates` are the frames as seen by the first moment, the best first;
    `reason` is a sentence.
    """

    kind: Kind
    object: str
    frame: str
    position: Vec3
    tolerance: float
    moments: tuple[Moment, ...]
    candidates: tuple[Candidate, ...]
    reason: str

    @property
    def behavior(self) -> Behavior:
        if self.kind == "pick":
            return Behavior("pick", (self.object,))
        return Behavior("place", (self.object, self.position, self.frame))


@dataclasses.dataclass(frozen=True)
class _Observed:
    """An action with the object that it handles."""

    moment: Moment
    action: Action
    object: str


def infer(demonstrations: Demonstrations, *, movable: Collection[str]) -> tuple[Inference, ...]:
    """The distinct actions of a set of demonstrations, in the order in which they are first seen.

    Where two frames fit equally well, one of a `movable` object is preferred to a fixture's, since that object may stand
    elsewhere next time, and either to the robot's.
    """
    frames = demonstrations.frames
    order = sorted(frames.names, key=lambda name: (name == frames.robot, name not in movable))
    frames = dataclasses.replace(frames, names=tuple(order))
    groups: dict[tuple[str, str], list[_Observed]] = {}
    for observed in _observed(demonstrations):
        groups.setdefault((observed.action.kind, observed.object), []).append(observed)
    found = [inference for group in groups.values() for inference in _infer_group(group, frames, len(demonstrations))]
    return tuple(sorted(found, key=lambda inference: min((m.index, m.demonstration) for m in inference.moments)))


def _observed(demonstrations: Demonstrations) -> list[_Observed]:
    found = []
    for d, demonstration in enumerate(demonstrations):
        held = ""
        for i, action in enumerate(demonstration.actions):
            held = action.nearest(demonstrations.frames.objects) if action.kind == "pick" else held
            found.append(_Observed(Moment(d, i), action, held))
    return found


def _infer_group(group: Sequence[_Observed], frames: Frames, count: int) -> list[Inference]:
    """Splits actions of one type on one object into those that mean the same."""
    first = group[0]
    kind, thing = first.action.kind, first.object
    names = [frame for frame in frames.names if kind == "pick" or frame != thing]
    positions = {frame: np.array([one.action.handled(frame) for one in group]) for frame in names}
    moments = [one.moment for one in group]
    if count < NEEDED:
        frame = thing if kind == "pick" else frames.default
        why = (
            "a pick is meant in the frame of its object"
            if kind == "pick"
            else f"{count} of {NEEDED} demonstrations needed to tell a frame, so it is {frame}"
        )
        labels = _labels(positions[frame], SAME_PLACE, 1)
        members = [np.flatnonzero(labels == label) for label in sorted(set(labels.tolist()))]
        return [_inference(kind, thing, frame, positions, moments, rows, (), why) for rows in members]

    min_samples = NEEDED if count <= NEEDED else count // 2 + 1
    clusters = {frame: _labels(positions[frame], EPS, min_samples) for frame in names}
    ranked = [_ranked(row, clusters, positions, moments, frames) for row in range(len(group))]
    if kind == "pick":
        ranked = [sorted(own, key=lambda candidate: candidate.frame != thing) for own in ranked]
    found = []
    for rows in _meanings(moments, ranked, clusters, kind, count):
        own = ranked[rows[0]]
        alone = own[0].score == -math.inf
        frame = thing if kind == "pick" else frames.default if alone else own[0].frame
        why = _reason(kind, frame, own, alone, min_samples)
        found.append(_inference(kind, thing, frame, positions, moments, np.array(rows), own, why))
    return found


def _meanings(
    moments: Sequence[Moment],
    ranked: Sequence[Sequence[Candidate]],
    clusters: dict[str, np.ndarray],
    kind: Kind,
    count: int,
) -> list[list[int]]:
    """Rows of actions that mean the same: those of one cluster in their best frame.

    Where a demonstration has several of them, they are told apart by the cluster in the second-best frame, if that is a
    good one, and otherwise by their order.
    """
    together: dict[tuple, list[int]] = {}
    for row, own in enumerate(ranked):
        alone = own[0].score == -math.inf and kind == "place"
        together.setdefault(("", row) if alone else (own[0].frame, int(clusters[own[0].frame][row])), []).append(row)
    found: dict[tuple, list[int]] = {}
    for meaning, rows in together.items():
        repeated = len({moments[row].demonstration for row in rows}) < len(rows)
        occurrence: dict[tuple, int] = {}
        for row in rows:
            if repeated:
                second = ranked[row][1]
                good = second.score >= SPLIT_SCORE * count
                key = (*meaning, second.frame, int(clusters[second.frame][row])) if good else (*meaning, "")
                nth = occurrence[(*key, moments[row].demonstration)] = (
                    occurrence.get((*key, moments[row].demonstration), -1) + 1
                )
                found.setdefault((*key, nth), []).append(row)
            else:
                found.setdefault(meaning, []).append(row)
    return list(found.values())


def _labels(points: Float[np.ndarray, "n 3"], eps: float, min_samples: int) -> np.ndarray:
    return DBSCAN(eps=eps, min_samples=min_samples).fit_predict(points)


def _ranked(
    row: int,
    clusters: dict[str, np.ndarray],
    positions: dict[str, np.ndarray],
    moments: Sequence[Moment],
    frames: Frames,
) -> tuple[Candidate, ...]:
    """The candidate frames of one action, the best first; equals in the order of the frames."""
    found = []
    for frame, labels in clusters.items():
        rows = np.flatnonzero(labels == labels[row]) if labels[row] >= 0 else np.array([row])
        points = positions[frame][rows]
        mean = points.mean(axis=0)
        spread = float(np.linalg.norm(points - mean, axis=1).max())
        score = len(rows) / max(spread, SPREAD_FLOOR) if len(rows) > 1 else -math.inf
        members = tuple(moments[i] for i in rows)
        found.append(Candidate(frame, float(f"{score:.6g}"), members, tuple(mean.round(4).tolist()), spread))
    return tuple(sorted(found, key=lambda one: (-one.score, frames.names.index(one.frame))))


def _inference(
    kind: Kind,
    thing: str,
    frame: str,
    positions: dict[str, np.ndarray],
    moments: Sequence[Moment],
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
        position=tuple(round(float(x), 3) + 0.0 for x in mean),
        tolerance=float(np.linalg.norm(points - mean, axis=1).max()),
        moments=tuple(moments[row] for row in rows),
        candidates=tuple(candidates),
        reason=reason,
    )


def _reason(kind: Kind, frame: str, own: Sequence[Candidate], alone: bool, min_samples: int) -> str:
    if kind == "pick":
        return "a pick is meant in the frame of its object"
    if alone:
        return f"no frame has {min_samples} demonstrations that agree within {EPS} m, so it is {frame}"
    best, second = own[0], own[1]
    agree = f"{best.size} agree within {1000 * max(best.spread, SPREAD_FLOOR):.0f} mm in {frame}"
    if second.score == best.score:
        return f"{agree}; {second.frame} fits as well"
    if second.score == -math.inf:
        return f"{agree}, and in no other frame"
    return f"{agree}, in {second.frame} within {1000 * max(second.spread, SPREAD_FLOOR):.0f} mm"
