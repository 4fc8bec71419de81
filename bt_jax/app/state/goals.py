"""Where objects should be, target by target. A target goes by a key: the name of its object, or that of its part with a
number, as in "Bolt-2", since a part has several."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np

from bt_jax.app.state.extents import Pose, heading, in_world, stands, turned
from bt_jax.mjx_env.world import World, frames
from bt_jax.tasks import Target, Task

__all__ = ["Goal", "goals", "key_of", "kind_of", "new_key", "target_keys"]


@dataclasses.dataclass(frozen=True, eq=False)
class Goal:
    """Where a target is in the world once all targets are met; `thing` is the object of the target, or an instance that
    stands for any of its part."""

    target: Target
    thing: str
    pose: Pose


def target_keys(task: Task) -> dict[str, Target]:
    """Return the targets by their keys, in their order."""
    counts: Counter[str] = Counter()
    found = {}
    for target in task.targets:
        counts[target.object] += 1
        is_part = target.object not in task.object_names
        found[f"{target.object}-{counts[target.object]}" if is_part else target.object] = target
    return found


def kind_of(key: str) -> str:
    """Return the object or part of a target's key."""
    return key.partition("-")[0]


def new_key(task: Task, kind: str) -> str:
    """Return the key of the next target of an object or part."""
    if kind in task.object_names:
        return kind
    return f"{kind}-{1 + sum(target.object == kind for target in task.targets)}"


def key_of(task: Task, world: World, name: str) -> str:
    """Return the key of the target that is meant by its own key or by an object: the target of the object or, if it is an
    instance of a part, the one for which it stands now; that of one more target if it has none."""
    if name in target_keys(task):
        return name
    own = next((key for key, goal in goals(task, world).items() if goal.thing == name), None)
    return new_key(task, task.thing(name).part or name) if own is None else own


def goals(task: Task, world: World) -> dict[str, Goal]:
    """Return where things should be once all targets are met, by the keys of their targets, given where the others are in
    `world`, a batch of one (NumPy)."""
    keys = target_keys(task)
    own = {target.object: key for key, target in keys.items() if target.object in task.object_names}
    now = dict(zip(task.frames, np.asarray(frames(world, task)[0], float), strict=True))
    things = _things(task, keys)
    found: dict[str, Goal] = {}

    def goal(key: str) -> Goal:
        if key not in found:
            target, thing = keys[key], things[key]
            frame = goal(own[target.frame]).pose if target.frame in own else now[target.frame]
            position = in_world(frame, np.array(target.position))
            found[key] = Goal(target, thing, turned(position, _turn(task, target, thing, frame, now[thing])))
        return found[key]

    return {key: goal(key) for key in keys}


def _things(task: Task, keys: dict[str, Target]) -> dict[str, str]:
    """Return an object for each target: its own, and for those of a part the instances in their order."""
    named = {target.object for target in keys.values()}
    free = {kind: sorted(task.instances[kind], key=named.__contains__) for kind in named}
    return {key: target.object if key == target.object else free[target.object].pop(0) for key, target in keys.items()}


def _turn(task: Task, target: Target, thing: str, frame: Pose, now: Pose) -> float:
    """Return how far an object is turned at its target, degrees: as the target says, the shorter way from how it lies, or
    else as it lies."""
    is_its_own = target.object == thing
    if target.turn is None:
        return heading(now) if is_its_own and stands(now) else heading(frame)
    turn, period = heading(frame) + target.turn, task.thing(thing).symmetry
    return turn + period * round((heading(now) - turn) / period) if is_its_own and period else turn
