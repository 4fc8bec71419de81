"""Demonstrations made by computer, whose frames and goals are known.

The demonstrator carries every box straight to its place. There is no physics: a box stays where it is released, but for its
height, which is that of the place. For tests, for measuring how well frames are inferred, and to demonstrate in experiments
without a person.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT, Action, Demonstration, Demonstrations, Frames, Kind, Pose
from bt_jax.mjx_env.world import World, poses_by_name
from bt_jax.tasks import Object, Target, Task

__all__ = [
    "demonstrate",
    "demonstration_set",
    "on_one_table",
    "random_situations",
    "random_truth",
    "reordered",
    "with_boxes",
]

TRIES = 1000
ROOMY = 0.125  # margin of a table on which six boxes have room, metres
MORE_BOXES = (("RedBox", (0.8, 0.2, 0.15)), ("WhiteBox", (0.9, 0.9, 0.9)), ("BlackBox", (0.1, 0.1, 0.1)))
ON_TOP = 0.5  # probability that a place in the frame of a box is on it, and not beside it
ASIDE = 0.3  # probability that a box is put aside before it gets its place
EDGE = 0.015  # how far the centre of a box that is put aside is from the edge of the table, metres

Positions = dict[str, Float[np.ndarray, "3"]]


def demonstrate(
    task: Task,
    placements: Sequence[Target],
    *,
    rng: np.random.Generator,
    noise: float = 0.0,
    name: str = "demo1",
    start: World | None = None,
) -> Demonstration:
    """Move boxes, one after the other, from a random layout of the task, or the state `start`, to their places, and return
    the recording.

    `noise` is the standard deviation of a release along each axis [m]. Layout and noise are drawn from `rng` in a way that
    the same generator without noise shows the same layout. Raise UserError if there is no room for the boxes.
    """
    positions = _random_layout(task, rng) if start is None else _positions(task, start)
    frames = Frames.of(task).names
    actions = []
    for placement in placements:
        thing = placement.object
        actions.append(_record("pick", positions[thing], positions, frames))
        goal = positions[placement.frame] + placement.position
        released = goal + noise * rng.standard_normal(3)
        positions = {**positions, thing: np.array([*released[:2], goal[2]])}
        actions.append(_record("place", released, positions, frames))
    return Demonstration(name, tuple(actions))


def demonstration_set(
    task: Task, placements: Sequence[Target], *, count: int, rng: np.random.Generator, noise: float = 0.0
) -> Demonstrations:
    """Return several demonstrations of the same placements in the same order, each in another layout."""
    shown = [demonstrate(task, placements, rng=rng, noise=noise, name=f"demo{i + 1}") for i in range(count)]
    return Demonstrations(Frames.of(task), tuple(shown))


def with_boxes(task: Task, count: int) -> Task:
    """Return the task with this many boxes, at most three more than it has, all of the size of its first; targets of
    boxes that it no longer has are dropped."""
    size = task.objects[0].edge
    boxes = (*task.objects, *(Object(name, (size, size, size), color) for name, color in MORE_BOXES))[:count]
    names = {box.name for box in boxes}
    gone = {box.name for box in task.objects} - names
    targets = tuple(one for one in task.targets if one.object in names and one.frame not in gone)
    return dataclasses.replace(task, name=f"{task.name}_{count}", objects=boxes, targets=targets)


def on_one_table(task: Task) -> Task:
    """Return the task with all boxes close together on the first table, and the kit on the second."""
    layout = dataclasses.replace(task.layout, kit=task.tables[1].name, margin=ROOMY)
    return dataclasses.replace(task, tables=task.tables[:2], layout=layout)


def random_truth(task: Task, *, rng: np.random.Generator) -> tuple[Target, ...]:
    """Return what a demonstrator may show: at least one box goes to a random free place in the kit, on a box that stays,
    on one placed before, or at the edge of a table, which is a place in the robot's frame. Some boxes are put aside first.
    The task must have boxes of one size."""
    names = [str(name) for name in rng.permutation(task.object_names)]
    moved = names[: rng.integers(1, len(names) + 1)]
    edges = [_edge_spots(task, table) for table in range(len(task.tables))]
    spots = [tuple(spot) for spot in rng.permutation(np.concatenate(edges))]
    cells = [tuple(cell) for cell in rng.permutation(_kit_cells(task))]
    tops = [name for name in names if name not in moved]  # boxes that another one may be put on
    size = task.objects[0].edge
    aside = [_target(name, spots.pop(), task.robot_frame) for name in moved if rng.random() < ASIDE]
    placed = []
    for name in moved:
        frame = rng.choice(["kit", "robot", "box"]) if tops else rng.choice(["kit", "robot"])
        if frame == "box":
            under = tops.pop(rng.integers(len(tops)))
            placed.append(_target(name, (0.0, 0.0, size), under))
        elif frame == "kit" and cells:
            placed.append(_target(name, cells.pop(), task.kits[0].name))
        else:
            placed.append(_target(name, spots.pop(), task.robot_frame))
        tops.append(name)
    return (*aside, *placed)


def random_situations(task: Task, *, rng: np.random.Generator) -> tuple[tuple[Target, ...], tuple[Target, ...]]:
    """Return what a demonstrator may show in two situations: a box goes to a place in one frame, in the first situation
    perhaps after it was put aside, or else to a place in another frame; some of the remaining boxes go to the kit. The task
    must have at least three boxes, all of one size."""
    thing, *others = (str(name) for name in rng.permutation(task.object_names))
    frames = [str(name) for name in rng.permutation([*others, task.kits[0].name, task.robot_frame])[:2]]
    cells = [tuple(cell) for cell in rng.permutation(_kit_cells(task))]
    spots = np.concatenate([_edge_spots(task, table) for table in range(len(task.tables))])
    edges = [tuple(spot) for spot in rng.permutation(spots)]
    size = task.objects[0].edge

    def place(frame: str) -> Target:
        if frame == task.robot_frame:
            return _target(thing, edges[0], frame)
        if frame == task.kits[0].name:
            return _target(thing, cells.pop(), frame)
        x, y = rng.permutation([size + task.genes.gap, 0.0]) * rng.choice([-1, 1])
        return _target(thing, (0.0, 0.0, size) if rng.random() < ON_TOP else (x, y, 0.0), frame)

    first, second = map(place, frames)
    aside = (_target(thing, edges[1], task.robot_frame),) if rng.random() < ASIDE else ()
    rest = [
        _target(name, cells.pop(), task.kits[0].name) for name in others if name not in frames and rng.random() < 0.5
    ]
    return (*aside, first, *rest), (second, *rest)


def reordered(placements: Sequence[Target], *, rng: np.random.Generator) -> tuple[Target, ...]:
    """Return the same placements in a random order in which those that concern the same box keep theirs."""
    left, found = list(placements), []
    while left:
        free = [i for i, one in enumerate(left) if not any(_concern_same(one, earlier) for earlier in left[:i])]
        found.append(left.pop(free[rng.integers(len(free))]))
    return tuple(found)


def _concern_same(a: Target, b: Target) -> bool:
    return a.object in (b.object, b.frame) or b.object == a.frame


def _record(kind: Kind, handled: Float[np.ndarray, "3"], positions: Positions, frames: Sequence[str]) -> Action:
    above = handled + np.array([0.0, 0.0, END_EFFECTOR_HEIGHT])
    return Action(kind, {frame: Pose(tuple((above - positions[frame]).tolist())) for frame in frames})


def _random_layout(task: Task, rng: np.random.Generator) -> Positions:
    """Return where every frame is in the world: the kit in the middle of one table, the boxes on the others, or, those
    of the task's stack, on each other."""
    kit = task.layout.kit
    table = task.tables[rng.integers(len(task.tables))]
    table = table if kit == "random" else next(one for one in task.tables if one.name == kit)
    others = [one for one in task.tables if one is not table]
    positions = {
        task.robot_frame: np.array(task.robot_position),
        task.kits[0].name: np.array([*table.position[:2], table.top + task.kits[0].thickness / 2]),
    }
    sizes = {box.name: box.edge for box in task.objects}
    stack = task.layout.stack
    groups = [stack] * bool(stack) + [(name,) for name in task.object_names if name not in stack]
    for _ in range(TRIES):
        spots: list[np.ndarray] = []
        for group in groups:
            on = others[rng.integers(len(others))]
            room = np.array(on.size[:2]) / 2 - task.layout.margin
            spots.append(np.array(on.position[:2]) + rng.uniform(-room, room))
            height = on.top
            for name in group:
                positions[name] = np.array([*spots[-1], height + sizes[name] / 2])
                height += sizes[name]
        gaps = [np.linalg.norm(a - b) for i, a in enumerate(spots) for b in spots[:i]]
        if not gaps or min(gaps) >= task.layout.spacing:
            return positions
    raise UserError(f"task {task.name}: no room for all boxes after {TRIES} tries; lower layout.spacing")


def _positions(task: Task, start: World) -> Positions:
    """Return where every frame is in the world in a state."""
    return {name: np.array(pose.position) for name, pose in poses_by_name(start, task).items() if name in task.frames}


def _kit_cells(task: Task) -> Float[np.ndarray, "n 3"]:
    """Return centres of boxes that stand in the kit side by side, in its frame."""
    size = task.objects[0].edge
    steps = task.genes.pitch * (np.arange(task.genes.grid) - (task.genes.grid - 1) / 2)
    return np.array([(x, y, (task.kits[0].thickness + size) / 2) for x in steps for y in steps])


def _edge_spots(task: Task, table: int) -> Float[np.ndarray, "n 3"]:
    """Return centres of boxes along two edges of a table, beyond where layouts put anything, in the robot's frame."""
    one, size = task.tables[table], task.objects[0].edge
    along = one.size[0] / 2 - size
    xs = np.arange(-along, along + 1e-9, 1.5 * size)
    spots = [(x, side * (one.size[1] / 2 - EDGE), one.size[2] / 2 + size / 2) for x in xs for side in (-1, 1)]
    return np.array(spots) + one.position - np.array(task.robot_position)


def _target(name: str, position: Sequence[float], frame: str) -> Target:
    x, y, z = (round(float(x), 4) + 0.0 for x in position)
    return Target(name, (x, y, z), frame)
