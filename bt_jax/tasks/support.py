"""Whether anything can be under a target: a box whose target is in the air falls, and no tree can keep it there."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator

from bt_jax.tasks.task import Target, Task
from bt_jax.tasks.things import Object, Table, Vec3

__all__ = ["about_vertical", "added", "kit_origin", "resolve", "resolve_turned", "start_turn", "unsupported"]

COMBINED = 8  # loose boxes whose stacks are considered; with more, nearly every height is possible


@dataclasses.dataclass(frozen=True)
class _Top:
    """A level square or rectangle to stand on: its middle, half its edges and its height [m]."""

    x: float
    y: float
    half_x: float
    half_y: float
    z: float

    def is_under(self, x: float, y: float, half_x: float, half_y: float) -> bool:
        return abs(x - self.x) < self.half_x + half_x and abs(y - self.y) < self.half_y + half_y


def unsupported(task: Task) -> Iterator[tuple[int, float]]:
    """Yield the number of each target with nothing under it, and the nearest z [m], in its frame, with something under it.

    What is not known before an episode counts as possible: the table of a kit that is placed at random, and boxes without a
    target in the same scene of reference, alone or stacked, in any place.
    """
    places = [resolve_turned(task, target) for target in task.targets]
    for i, target in enumerate(task.targets):
        root, (x, y, z), turn = places[i]
        half_x, half_y, half = task.thing(target.object).half_at(turn)
        placed = [
            (other.object, at, task.thing(other.object).half_at(turned))
            for other, (of, at, turned) in zip(task.targets, places, strict=True)
            if of == root and other is not target
        ]
        tops = [*_tops(task, root), *(_Top(at[0], at[1], a, b, at[2] + c) for _, at, (a, b, c) in placed)]
        used = Counter([target.object, root, *(name for name, _, _ in placed)])
        loose = [thing.height for thing in task.objects if not _is_used(thing, used)]
        if len(loose) > COMBINED or (root in task.object_names and z - half <= -task.thing(root).height / 2):
            continue
        stacks = {sum(some) for count in range(len(loose) + 1) for some in itertools.combinations(loose, count)}
        heights = [top.z + stack + half for top in tops if top.is_under(x, y, half_x, half_y) for stack in stacks]
        nearest = min(heights, key=lambda height: abs(height - z))
        if abs(nearest - z) > task.episode.tolerance:
            yield i, target.position[2] + nearest - z


def resolve(task: Task, target: Target) -> tuple[str, Vec3]:
    """Return where a target is in the frame that its chain of objects begins with, and that frame: one without a target."""
    root, position, _ = resolve_turned(task, target)
    return root, position


def start_turn(task: Task, name: str) -> float | None:
    """Return how an object is turned in the world at the start of an episode, degrees; None if that is not the same in all
    layouts, or for all instances of a part."""
    fixed = {place.object: place.turn or 0.0 for place in task.layout.fixed}
    turns = {fixed.get(one, None if task.layout.turn else 0.0) for one in task.instances[name]}
    return turns.pop() if len(turns) == 1 else None


def resolve_turned(task: Task, target: Target) -> tuple[str, Vec3, float]:
    """Return the frame that a target's chain of objects begins with, and position and turn [degrees] in it. An object that
    no target turns is taken to be turned as at the start, or not at all if that is not known."""
    below = next((one for one in task.targets if one.object == target.frame and one.object in task.object_names), None)
    if below is None:
        of_root = start_turn(task, target.frame) if target.frame in task.object_names else 0.0
        turn = (start_turn(task, target.object) or 0.0) - (of_root or 0.0) if target.turn is None else target.turn
        return target.frame, target.position, turn
    root, base, turned = resolve_turned(task, below)
    turn = (
        resolve_turned(task, dataclasses.replace(target, frame=root))[2]
        if target.turn is None
        else turned + target.turn
    )
    return root, added(base, about_vertical(target.position, turned)), turn


def about_vertical(point: Vec3, turn: float) -> Vec3:
    """Return a point turned by so many degrees about the vertical."""
    if not turn:
        return point
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return c * point[0] - s * point[1], s * point[0] + c * point[1], point[2]


def added(a: Vec3, b: Vec3) -> Vec3:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _is_used(thing: Object, used: Counter[str]) -> bool:
    """Return whether an object has a target, or is one of as many instances as targets of its part; counts it."""
    name = thing.name if used[thing.name] else thing.part
    used[name] -= 1
    return used[name] >= 0


def _tops(task: Task, frame: str) -> Iterator[_Top]:
    """Yield everything but objects with a target to stand on, in a frame, for every table that a kit may be on."""
    if frame in task.object_names:
        x, y, z = task.thing(frame).half_at(None)
        yield from (_Top(0.0, 0.0, x, y, z), _Top(0.0, 0.0, math.inf, math.inf, -z))
        return
    for table in task.tables:
        if task.layout.kit in ("random", table.name):
            x, y, z = task.robot_position if frame == task.robot_frame else kit_origin(task, table, frame)
            for top in _world_tops(task, table):
                yield dataclasses.replace(top, x=top.x - x, y=top.y - y, z=top.z - z)


def _world_tops(task: Task, kit_table: Table) -> Iterator[_Top]:
    yield _Top(0.0, 0.0, math.inf, math.inf, task.floor)
    for table in task.tables:
        yield _Top(table.position[0], table.position[1], table.size[0] / 2, table.size[1] / 2, table.top)
    for kit in task.kits:
        x, y, z = kit_origin(task, kit_table, kit.name)
        yield _Top(x, y, *kit.half, z + kit.plate)
        yield _Top(x, y, *kit.half, z + kit.rim)


def kit_origin(task: Task, table: Table, kit: str | None = None) -> Vec3:
    """Return where the frame of a kit (default: the first) is in the world, if the kits that do not name their table stand
    on `table`."""
    one = task.kits[0 if kit is None else task.kit_names.index(kit)]
    own = next((other for other in task.tables if other.name == one.table), table)
    return own.position[0] + one.position[0], own.position[1] + one.position[1], own.top + one.thickness / 2
