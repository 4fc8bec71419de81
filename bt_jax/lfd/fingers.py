"""Where the fingers of the gripper go to take an object, as blocks in the world [m]; `mjx_env.predicates.graspable` says the
same of a state."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bt_jax.lfd.extents import Extent, block_at, half_of
from bt_jax.tasks import Task
from bt_jax.tasks.support import about_vertical, added
from bt_jax.tasks.things import Kit, Vec3

__all__ = ["grasps", "hit", "walls"]


def grasps(task: Task, name: str, centre: Vec3, turn: float | None) -> list[tuple[Extent, ...]]:
    """Return what the fingers fill for each way to take an object that stands at `centre`, turned by `turn` degrees; nothing
    in a task whose fingers need no room. Of an object that may be turned by any angle it is all around."""
    thing, room = task.thing(name), task.finger_room
    if not room:
        return [()]
    above = centre[2] + thing.height / 4, thing.height / 4
    if turn is None:
        x, y, _ = half_of(task, name, None)
        return [(block_at((centre[0], centre[1], above[0]), (x + room, y + room, above[1])),)]
    found = []
    for axis in (0, 1):
        if thing.size[axis] <= task.gripper_opening:
            away = thing.size[axis] / 2 + room / 2
            sides = [(away, 0.0, 0.0), (-away, 0.0, 0.0)] if axis == 0 else [(0.0, away, 0.0), (0.0, -away, 0.0)]
            middles = [added(centre, about_vertical(side, turn)) for side in sides]
            x, y, _ = about_vertical((room / 2, room / 2, 0.0), -abs((turn + 45) % 90 - 45))
            reach = max(abs(x), abs(y))  # of the block around a square finger
            found.append(tuple(block_at((x, y, above[0]), (reach, reach, above[1])) for x, y, _ in middles))
    return found


def hit(fingers: Iterable[Extent], other: Extent) -> bool:
    """Return whether any of the fingers meets a block."""
    return any(finger.gap(other) < 0 and other.top > finger.bottom and other.bottom < finger.top for finger in fingers)


def walls(kit: Kit, origin: Vec3) -> Iterator[Extent]:
    """Yield the walls of a kit whose frame is at `origin`."""
    for (x, y), (half_x, half_y) in kit.walls():
        yield Extent(origin[0] + x, origin[1] + y, half_x, half_y, origin[2] + kit.plate, origin[2] + kit.rim)
