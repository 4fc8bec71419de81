"""A small picture of a task: its kits with everything where it should be, from the side of a person who faces the robot."""

from __future__ import annotations

import dataclasses
import functools
import graphlib
import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np

from bt_jax.app.state.extents import half_of, heading
from bt_jax.app.state.goals import goals
from bt_jax.app.state.kit.starting import first_start
from bt_jax.tasks import Task
from bt_jax.tasks.things import Vec2, Vec3

__all__ = ["task_picture"]

AROUND, ABOVE = math.radians(-28), math.radians(36)  # where one looks from: about the vertical, over the horizon
TRAY: Vec3 = (0.62, 0.67, 0.72)
TOP, FRONT, SIDE = 1.0, 0.84, 0.68  # how bright the faces are
MARGIN = 0.06  # of the picture's longer edge
TOUCH = 1e-4  # metres
APART = 0.05  # metres between what is on different tables


@dataclasses.dataclass(frozen=True)
class _Block:
    """A cuboid or an upright cylinder; to the right, away and up, metres; `turn` in radians about the vertical."""

    middle: Vec3
    half: Vec3
    turn: float
    color: Vec3
    round: bool = False

    @functools.cached_property
    def low(self) -> tuple[float, ...]:
        return tuple(a - b for a, b in zip(self.middle, self._around, strict=True))

    @functools.cached_property
    def high(self) -> tuple[float, ...]:
        return tuple(a + b for a, b in zip(self.middle, self._around, strict=True))

    @property
    def _around(self) -> Vec3:
        """Half the extents of the block around it that is not turned."""
        c, s = abs(math.cos(self.turn)), abs(math.sin(self.turn))
        x, y, z = self.half
        return self.half if self.round else (c * x + s * y, s * x + c * y, z)

    def corners(self, z: float) -> list[Vec3]:
        """Return the corners at a height, counter-clockwise from above."""
        c, s = math.cos(self.turn), math.sin(self.turn)
        x, y, _ = self.half
        around = ((-x, -y), (x, -y), (x, y), (-x, y))
        return [(self.middle[0] + c * a - s * b, self.middle[1] + s * a + c * b, z) for a, b in around]


@functools.lru_cache(maxsize=64)
def task_picture(task: Task) -> str:
    """Return the picture as SVG that scales to its container."""
    shapes = [shape for block in _from_behind(_together(task, list(_blocks(task)))) for shape in _drawn(block)]
    points = [point for _, outline in shapes for point in outline]
    (left, right), (top, bottom) = ((min(values), max(values)) for values in zip(*points, strict=True))
    edge = MARGIN * max(right - left, bottom - top)
    box = f"{left - edge:.1f} {top - edge:.1f} {right - left + 2 * edge:.1f} {bottom - top + 2 * edge:.1f}"
    drawn = "".join(text for text, _ in shapes)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}" aria-hidden="true" class="task-picture">{drawn}</svg>'
    )


def _blocks(task: Task) -> Iterator[_Block]:
    start = first_start(task)
    for kit, origin in zip(task.kits, start.kits[0].tolist(), strict=True):
        yield _block(task, (origin[0], origin[1], origin[2]), (*kit.half, kit.thickness / 2), 0.0, TRAY)
        for (x, y), half in kit.walls():
            middle = origin[0] + x, origin[1] + y, origin[2] + kit.plate + kit.wall_height / 2
            yield _block(task, middle, (*half, kit.wall_height / 2), 0.0, TRAY)
    for goal in goals(task, start).values():
        thing = task.thing(goal.thing)
        x, y, z = goal.pose[:3].tolist()
        a, b, c = (half_of(thing, goal.pose) if thing.shape == "cylinder" else np.array(thing.size) / 2).tolist()
        yield _block(
            task, (x, y, z), (a, b, c), math.radians(heading(goal.pose)), thing.color, thing.shape == "cylinder"
        )


def _block(task: Task, at: Vec3, half: Vec3, turn: float, color: Vec3, is_round: bool = False) -> _Block:
    right, away = (sum(a * b for a, b in zip(at[:2], axis[:2], strict=True)) for axis in (task.right, task.away))
    return _Block((right, away, at[2]), half, turn - math.atan2(task.right[1], task.right[0]), color, is_round)


def _together(task: Task, blocks: Sequence[_Block]) -> list[_Block]:
    """Return the blocks with what is on different tables close together."""
    middles = sorted(sum(a * b for a, b in zip(table.position, task.right, strict=True)) for table in task.tables)
    on: list[list[_Block]] = [[] for _ in middles]
    for block in blocks:
        on[min(range(len(middles)), key=lambda i: abs(middles[i] - block.middle[0]))].append(block)
    found: list[_Block] = []
    for group in filter(None, on):
        shift = max(one.high[0] for one in found) + APART - min(one.low[0] for one in group) if found else 0.0
        found += [dataclasses.replace(one, middle=(one.middle[0] + shift, *one.middle[1:])) for one in group]
    return found


def _from_behind(blocks: Sequence[_Block]) -> list[_Block]:
    """Return the blocks in the order in which they are drawn: what may hide another comes after it."""
    order: dict[int, set[int]] = {i: set() for i in range(len(blocks))}
    for (i, one), (j, other) in itertools.combinations(enumerate(blocks), 2):
        if (hides := _hides(one, other)) is not None:
            order[i if hides else j].add(j if hides else i)
    try:
        return [blocks[i] for i in graphlib.TopologicalSorter(order).static_order()]
    except graphlib.CycleError:
        return sorted(blocks, key=lambda block: (round(block.low[2], 3), -_depth(block.middle)))


def _hides(one: _Block, other: _Block) -> bool | None:
    """Return whether a block may hide the other (True) or be hidden by it (False); None if they overlap."""
    for axis, nearer_is_low in ((2, False), (1, True), (0, True)):
        if one.high[axis] <= other.low[axis] + TOUCH:
            return nearer_is_low
        if other.high[axis] <= one.low[axis] + TOUCH:
            return not nearer_is_low
    return None


def _drawn(block: _Block) -> Iterator[tuple[str, list[Vec2]]]:
    """Yield the faces that are seen, as SVG and as points."""
    low, high = block.low[2], block.high[2]
    if block.round:
        yield from _cylinder(block, low, high)
        return
    top, bottom = block.corners(high), block.corners(low)
    for i in range(4):
        j = (i + 1) % 4
        across, along = top[j][0] - top[i][0], top[j][1] - top[i][1]
        if _depth((along, -across, 0.0)) < 0:  # it faces the person
            bright = FRONT if abs(across) > abs(along) else SIDE
            yield _polygon([top[i], top[j], bottom[j], bottom[i]], block.color, bright)
    yield _polygon(top, block.color, TOP)


def _polygon(corners: Sequence[Vec3], color: Vec3, bright: float) -> tuple[str, list[Vec2]]:
    points = [_seen(corner) for corner in corners]
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polygon points="{text}" fill="{_css(color, bright)}"/>', points


def _cylinder(block: _Block, low: float, high: float) -> Iterator[tuple[str, list[Vec2]]]:
    (x, top), (_, bottom) = (_seen((*block.middle[:2], z)) for z in (high, low))
    across = 1000 * block.half[0]
    flat = across * math.sin(ABOVE)
    side = (
        f"M{x - across:.1f},{top:.1f}V{bottom:.1f}"
        f"A{across:.1f},{flat:.1f} 0 0 0 {x + across:.1f},{bottom:.1f}V{top:.1f}Z"
    )
    extent = [(x - across, top - flat), (x + across, bottom + flat)]
    yield f'<path d="{side}" fill="{_css(block.color, FRONT)}"/>', extent
    ellipse = f'cx="{x:.1f}" cy="{top:.1f}" rx="{across:.1f}" ry="{flat:.1f}"'
    yield f'<ellipse {ellipse} fill="{_css(block.color, TOP)}"/>', extent


def _depth(point: Vec3) -> float:
    """Return how far away a point is, seen along the horizon."""
    return math.cos(AROUND) * point[1] - math.sin(AROUND) * point[0]


def _seen(point: Vec3) -> Vec2:
    """Return where a point is in the picture, millimetres to the right and down."""
    across = math.cos(AROUND) * point[0] + math.sin(AROUND) * point[1]
    up = math.cos(ABOVE) * point[2] + math.sin(ABOVE) * _depth(point)
    return 1000 * across, -1000 * up


def _css(color: Vec3, bright: float) -> str:
    return "#" + "".join(f"{round(255 * bright * part):02x}" for part in color)
