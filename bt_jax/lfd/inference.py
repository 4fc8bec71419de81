"""Inference of reference frames: an action is relative to the frame in which the demonstrations agree best.

The clusters in all frames overlap; those are taken that do not and whose evidence has the greatest sum, so that few places
explain many demonstrations. Frames that hardly moved relative to each other cannot be told apart: of those, an object is
relative to what it was put on, or else to the first. A place in a slot of a kit is that slot. The instances of a part are
one object: whichever of them was taken, any will do. Everything that was weighed is kept, to be shown.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Hashable, Iterable, Sequence

import numpy as np
from jaxtyping import Float

from bt_jax.behaviors import Behavior
from bt_jax.lfd.clustering import (
    HAND,
    NEEDED,
    REACH,
    SPREAD_FLOOR,
    Candidate,
    Group,
    Observed,
    Rows,
    Vec3,
    observe,
    occurrences,
)
from bt_jax.lfd.contact import supports
from bt_jax.lfd.dbscan import dbscan
from bt_jax.lfd.demonstration import Demonstrations, Instance, Kind
from bt_jax.lfd.packing import best_packing
from bt_jax.lfd.slots import slot_of
from bt_jax.lfd.turns import shown_turn
from bt_jax.tasks import Task

__all__ = ["SAME_PLACE", "Inference", "infer", "placed"]

SAME_PLACE = 0.03  # metres; with too few demonstrations, what lies closer together counts as one place
PICK = "a pick is relative to its object"


@dataclasses.dataclass(frozen=True)
class Inference:
    """What several observed actions are instances of, and why.

    `position` is the target of the object's centre in `frame` [m, rounded to mm], the mean over the `instances`;
    `tolerance` the largest distance from it. `candidates` are the frames as seen by the first instance, the chosen first and
    then the best; `tied` are other frames that the demonstrations cannot tell from it; `reason` is a sentence; `chosen`: a
    person has said that it is this frame. `turn` is how the object is turned in it, degrees, None where any turn will do,
    and `slot` the slot that position and turn are those of, as in "TrayA.a1"; `note` says what tells that, if anything does.
    """

    kind: Kind
    object: str
    frame: str
    position: Vec3
    tolerance: float
    instances: tuple[Instance, ...]
    candidates: tuple[Candidate, ...]
    reason: str
    tied: tuple[str, ...] = ()
    chosen: bool = False
    turn: float | None = None
    slot: str = ""
    note: str = ""

    @property
    def behavior(self) -> Behavior:
        if self.kind == "pick":
            return Behavior("pick", (self.object,))
        turn = () if self.turn is None else (self.turn,)
        return Behavior("place", (self.object, self.position, self.frame, *turn))


def infer(demonstrations: Demonstrations, task: Task) -> tuple[Inference, ...]:
    """Return the distinct actions of a set of demonstrations, in the order in which they are first seen."""
    groups: dict[tuple[str, str], list[Observed]] = {}
    for one in observe(demonstrations, task):
        groups.setdefault((one.action.kind, one.object), []).append(one)
    picked = {one.instance: one.thing for own in groups.values() for one in own if one.action.kind == "pick"}
    frames = demonstrations.frames
    names = sorted(frames.names, key=lambda name: name == frames.robot)
    found: list[Inference] = []
    for (kind, thing), own in groups.items():
        instances = task.instances.get(thing, (thing,))
        if kind == "place":
            candidates = tuple(name for name in names if name not in instances)
        else:
            candidates = tuple(names) if instances == (thing,) else (thing,)
        group = Group(tuple(own), candidates, picked)
        if len(demonstrations) < NEEDED:
            found += _as_shown(group, task, frames.default, len(demonstrations))
        elif kind == "pick":
            found += _agreed(group, task, group.everything, thing, ())
        else:
            found += _places(group, task, frames.default)
    return tuple(sorted(_merged(found, demonstrations, task), key=_first_seen))


def _first_seen(inference: Inference) -> tuple[int, int]:
    return min((one.index, one.demonstration) for one in inference.instances)


def _merged(inferences: Sequence[Inference], demonstrations: Demonstrations, task: Task) -> list[Inference]:
    """Return inferences of which those are one that different demonstrations place in the same slot."""
    found: list[Inference] = []
    for one in inferences:
        same = next(
            (other for other in found if one.slot and one.behavior == other.behavior and _apart(one, other)), None
        )
        if same is None:
            found.append(one)
        else:
            instances = {*same.instances, *one.instances}
            rows = [row for row in observe(demonstrations, task) if row.instance in instances]
            found[found.index(same)] = placed(rows, task, one.frame, same.reason, kits=[one.frame])
    return found


def _apart(one: Inference, other: Inference) -> bool:
    """Return whether no demonstration has both."""
    return not {m.demonstration for m in one.instances} & {m.demonstration for m in other.instances}


def _as_shown(group: Group, task: Task, default: str, count: int) -> list[Inference]:
    """Return the actions of too few demonstrations: what is done at one place is one."""
    place = group.kind == "place"
    frame = default if place else group.object
    labels = dbscan(group.positions[frame], SAME_PLACE, 1).tolist()
    found = [_inference(group, task, frame, rows, PICK) for rows in _in_turn(group, group.everything, labels)]
    why = f"{count} of {NEEDED} demonstrations needed to infer a frame"
    return [_by_default(one, why) for one in found] if place else found


def _by_default(inference: Inference, why: str) -> Inference:
    """Say why a place is in the default frame, unless a slot tells its frame."""
    end = "but a slot tells it" if inference.slot else f"so it is {inference.frame}"
    return dataclasses.replace(inference, reason=f"{why}, {end}")


def _places(group: Group, task: Task, default: str) -> list[Inference]:
    """Return the places of an object, each in its frame; the default is that of places on which no others agree."""
    values: dict[Rows, float] = {}
    for clusters in group.clusters.values():
        for rows, candidate in clusters.items():
            if candidate.evidence > 0 and len(group.demonstrations(rows)) >= NEEDED:
                values[rows] = max(values.get(rows, 0.0), candidate.evidence)
    together = best_packing(values)
    found = [one for rows in together for one in _agreed(group, task, rows, *_frame(group, rows, task))]
    why = f"no frame has {NEEDED} demonstrations that agree within {REACH} m"
    for row in sorted(group.everything.difference(*together)):
        one = _inference(group, task, default, [row], "", group.compared(row, frozenset([row]), default))
        found.append(_by_default(one, why))
    return found


def _frame(group: Group, rows: Rows, task: Task) -> tuple[str, tuple[str, ...]]:
    """Return the frame of rows that belong together, and the others that cannot be told from it.

    Of those, it is what the object is put on, if that is one thing, or else the first.
    """
    own = {frame: clusters[rows] for frame, clusters in group.clusters.items() if rows in clusters}
    best = max(own.values(), key=lambda one: one.merit)
    tied = [frame for frame in own if own[frame].leaves == best.leaves and group.still(frame, best.frame, rows)]
    under = {supports(group.observed[row].action, group.object, task) for row in rows}
    frame = next((frame for frame in tied if under == {(frame,)}), tied[0])
    return frame, tuple(other for other in tied if other != frame)


def _agreed(group: Group, task: Task, rows: Rows, frame: str, tied: tuple[str, ...]) -> list[Inference]:
    """Return the actions of a cluster in its frame; what one demonstration does several times is several."""
    found = []
    for part in _parts(group, rows, frame):
        kits = _kits(group, task, rows, frame)
        one = _inference(group, task, frame, part, PICK, group.compared(part[0], rows, frame), tied, kits)
        if group.kind == "place":
            others = [name for name in (frame, *tied) if name != one.frame] if tied else []
            one = dataclasses.replace(one, reason=_reason(one.candidates, others))
        found.append(one)
    return found


def _kits(group: Group, task: Task, rows: Rows, frame: str) -> list[str]:
    """Return the kits in which rows agree as closely as in their frame, to what a person can tell."""
    clusters = {name: own[rows] for name, own in group.clusters.items() if rows in own}
    most = clusters[frame].spread + HAND if frame in clusters else 0.0
    return [name for name in task.kit_names if name in clusters and clusters[name].spread <= most]


def _parts(group: Group, rows: Rows, frame: str) -> list[list[int]]:
    """Return the rows of a cluster, separated if a demonstration has several: by the cluster in the second-best frame, if
    those are good and separate all of them, and otherwise by their order."""
    instances = [group.observed[row].instance for row in sorted(rows)]
    one = [0] * len(rows)
    keys: Sequence[Hashable] = one
    if any(occurrences(instances, one)):
        second = [group.compared(row, rows, frame)[1:2] for row in sorted(rows)]
        keys = [own[0].members if own and own[0].good else () for own in second]
        keys = one if any(occurrences(instances, keys)) else keys
    return _in_turn(group, rows, keys)


def _in_turn(group: Group, rows: Iterable[int], keys: Sequence[Hashable]) -> list[list[int]]:
    """Return rows with the same key together, those of one demonstration separated by their order."""
    found: dict[Hashable, list[int]] = {}
    instances = [group.observed[row].instance for row in sorted(rows)]
    for row, key, nth in zip(sorted(rows), keys, occurrences(instances, keys), strict=True):
        found.setdefault((key, nth), []).append(row)
    return list(found.values())


def _inference(
    group: Group,
    task: Task,
    frame: str,
    rows: Sequence[int],
    reason: str,
    candidates: tuple[Candidate, ...] = (),
    tied: tuple[str, ...] = (),
    kits: Sequence[str] = (),
) -> Inference:
    own = [group.observed[row] for row in rows]
    if group.kind == "place":
        few = len(rows) < NEEDED and frame == task.robot_frame
        kits = task.kit_names if few else (frame, *tied, *kits)
        return placed(own, task, frame, reason, candidates, tied, kits=kits)
    if len(task.instances.get(group.object, ())) > 1:
        reason = _taken(own, group, task)
    return _at_mean(own, frame, reason, candidates, tied)


def placed(
    rows: Sequence[Observed],
    task: Task,
    frame: str,
    reason: str,
    candidates: tuple[Candidate, ...] = (),
    tied: tuple[str, ...] = (),
    *,
    kits: Sequence[str],
) -> Inference:
    """Return what placements of an object in a frame mean: the slot there of one of the `kits`, or else their mean, with the
    turn in which they agree."""
    thing = task.thing(rows[0].object)
    if (found := slot_of(rows, kits, thing, task)) is not None:
        own = tuple(sorted(candidates, key=lambda one: one.frame != found.kit.name))
        one = _at_mean(rows, found.kit.name, reason, own, ())
        note = f"{1000 * found.off:.0f} mm from the middle of the slot {found.name}"
        return dataclasses.replace(one, position=found.position, turn=found.turn, slot=found.name, note=note)
    one, turn = _at_mean(rows, frame, reason, candidates, tied), shown_turn(rows, frame, thing)
    if turn is not None:
        note = f"{turn.size} of {len(rows)} turned by {turn.degrees:g} degrees, within {max(turn.spread, 1):.0f}"
        return dataclasses.replace(one, turn=turn.degrees, note=note)
    return dataclasses.replace(one, note="the turns do not agree, so any will do" if thing.symmetry == 180 else "")


def _at_mean(
    rows: Sequence[Observed], frame: str, reason: str, candidates: tuple[Candidate, ...], tied: tuple[str, ...]
) -> Inference:
    points = np.array([one.handled(frame) for one in rows])
    mean = points.mean(axis=0)
    return Inference(
        kind=rows[0].action.kind,
        object=rows[0].object,
        frame=frame,
        position=_rounded(mean),
        tolerance=float(np.linalg.norm(points - mean, axis=1).max()),
        instances=tuple(one.instance for one in rows),
        candidates=candidates,
        reason=reason,
        tied=tied,
    )


def _taken(rows: Sequence[Observed], group: Group, task: Task) -> str:
    """Say which instances of a part were taken, and that it does not matter."""
    part, names = group.object, sorted({one.thing for one in rows}, key=task.object_names.index)
    if len(names) > 1:
        return f"{', '.join(names[:-1])} and {names[-1]} were taken, so any {part} will do"
    (name,) = names
    if not any(_nearer(one, group, task) for one in rows):
        return f"{name} was taken, and any {part} will do, as of every part"
    return (
        f"{name} was taken though another {part} lay nearer; any will do, as of every part: if it must be {name}, give that "
        "a name of its own in the task"
    )


def _nearer(taken: Observed, group: Group, task: Task) -> bool:
    """Return whether another instance lay nearer to the robot that had not been moved yet."""
    moved = {
        thing
        for instance, thing in group.picked.items()
        if instance.demonstration == taken.instance.demonstration and instance.index < taken.instance.index
    }

    def away(name: str) -> float:
        return float(np.linalg.norm(taken.action.origin(name, task.robot_frame)[:2]))

    others = [name for name in task.instances[group.object] if name not in moved and name != taken.thing]
    return any(away(name) < away(taken.thing) for name in others if name in taken.action.poses)


def _rounded(position: Float[np.ndarray, "3"]) -> Vec3:
    """Return a position [m], rounded to mm."""
    x, y, z = (round(float(x), 3) + 0.0 for x in position)
    return x, y, z


def _reason(own: Sequence[Candidate], tied: Sequence[str]) -> str:
    best, second = own[0], own[1] if len(own) > 1 else None
    agree = f"{best.size} agree within {1000 * max(best.spread, SPREAD_FLOOR):.0f} mm in {best.frame}"
    if second is None:
        return f"{agree}, the only frame"
    if tied:
        return f"{agree}; {' and '.join(tied)} {'fits' if len(tied) == 1 else 'fit'} as well"
    if second.score == -math.inf:
        return f"{agree}, and in no other frame"
    moved = ", which is moved later" if second.leaves else ""
    return f"{agree}, {second.size} in {second.frame} within {1000 * max(second.spread, SPREAD_FLOOR):.0f} mm{moved}"
