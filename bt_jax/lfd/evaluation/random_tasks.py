"""Tasks made by computer: random stacks at the start, random towers as targets."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np

from bt_jax.lfd.evaluation.synthetic import with_boxes
from bt_jax.tasks import Layout, Subgoal, Table, Target, Task
from bt_jax.tasks.checks import check, check_support
from bt_jax.tasks.things import Vec3

__all__ = ["random_task"]

STACKED, FIXED, SUBGOAL = 0.75, 0.25, 0.25  # how often there is a stack, fixed boxes, and a subgoal
ON_TOP, IN_KIT, ON_LOOSE = 0.5, 0.6, 0.3  # how often a target is on another, else in the kit, else around a loose box
CELL = 0.15  # distance of targets on a table, metres


def random_task(task: Task, *, boxes: int, rng: np.random.Generator) -> Task:
    """Return a task with this many boxes in the scene of another, whose boxes have one size and whose kit starts on any
    table. Its episodes have the ticks to move each box twice."""
    task = with_boxes(task, boxes)
    names = [str(name) for name in rng.permutation(task.object_names)]
    layout = _layout(task, names, rng)
    targets = _targets(dataclasses.replace(task, layout=layout), names, rng)
    unstacked = Subgoal("unstacked", ("holding(nothing)", "reachable({box})", "clear({box})"))
    made = dataclasses.replace(
        task,
        name="random",
        layout=layout,
        targets=tuple(targets[i] for i in rng.permutation(len(targets))),
        subgoals=(unstacked,) if rng.random() < SUBGOAL else (),
        episode=dataclasses.replace(task.episode, max_ticks=2 * 2 * boxes + task.episode.success_ticks),
    )
    check(made, "random task")
    check_support(made, "random task")
    return made


def _layout(task: Task, names: list[str], rng: np.random.Generator) -> Layout:
    layout, size, left = task.layout, task.objects[0].edge, list(names)
    if rng.random() < FIXED:
        kit, table = task.tables[0], task.tables[rng.integers(1, len(task.tables))]
        spot = _cells(task, table)[0]
        tower = [left.pop() for _ in range(rng.integers(1, min(3, len(left)) + 1))]
        fixed = [Target(name, _raised(spot, i * size), task.robot_frame) for i, name in enumerate(tower)]
        layout = dataclasses.replace(layout, kit=kit.name, fixed=tuple(fixed))
    if len(left) > 1 and rng.random() < STACKED:
        layout = dataclasses.replace(layout, stack=tuple(left[: rng.integers(2, len(left) + 1)]))
    return layout


def _targets(task: Task, names: list[str], rng: np.random.Generator) -> list[Target]:
    """Return places that are free of each other, for some of the boxes."""
    size = task.objects[0].edge
    chosen = [str(name) for name in rng.permutation(names)[: rng.integers(1, len(names) + 1)]]
    loose = [name for name in names if name not in chosen]
    low = (task.kits[0].thickness + size) / 2
    steps = task.genes.pitch * (np.arange(task.genes.grid) - (task.genes.grid - 1) / 2)
    in_kit = [(float(x), float(y), low) for x in steps for y in steps]
    kit = [table.name for table in task.tables if table.name != task.layout.kit]
    on_tables = [cell for table in task.tables if table.name in kit for cell in _cells(task, table)]
    if task.layout.kit == "random":
        on_tables = []
    rng.shuffle(in_kit)
    rng.shuffle(on_tables)
    targets: list[Target] = []
    for i, name in enumerate(chosen):
        others = [other for other in chosen[:i] if other not in [target.frame for target in targets]]
        if others and rng.random() < ON_TOP:
            targets.append(Target(name, (0.0, 0.0, size), others[rng.integers(len(others))]))
        elif rng.random() < IN_KIT or not (loose or on_tables):
            targets.append(Target(name, _point(in_kit.pop()), task.kits[0].name))
        elif loose and (not on_tables or rng.random() < ON_LOOSE):
            beside = size + task.genes.gap
            places = [(0.0, 0.0, size), (beside, 0.0, 0.0), (0.0, beside, 0.0)]
            targets.append(Target(name, places[rng.integers(3)], loose.pop()))
        else:
            targets.append(Target(name, _point(on_tables.pop()), task.robot_frame))
    return targets


def _cells(task: Task, table: Table) -> list[Vec3]:
    """Return where boxes may stand on a table, in the robot's frame; the middle is the first."""
    size, found = task.objects[0].edge, []
    for x in (0.0, -CELL, CELL):
        for y in (0.0, -CELL, CELL):
            world = (table.position[0] + x, table.position[1] + y, table.top + size / 2)
            found.append(_point(np.subtract(world, task.robot_position)))
    return found


def _raised(position: Vec3, height: float) -> Vec3:
    return _point((position[0], position[1], position[2] + height))


def _point(values: Iterable[float]) -> Vec3:
    x, y, z = (round(float(value), 4) + 0.0 for value in values)
    return x, y, z
