"""Tasks of any number of objects, made from those of the package."""

from __future__ import annotations

import dataclasses
import itertools
import re

from bt_jax.tasks import Target, Task, load_task
from bt_jax.tasks.written import LEAST_TICKS, TICKS_PER_TARGET

__all__ = ["kit", "named", "tower"]


def tower(count: int) -> Task:
    """Return the task of one stack of that many of the blocks of `towers`, 8 at most, on the first of its trays."""
    task = load_task("towers")
    blocks = task.objects[:count]
    height = blocks[0].size[2]
    stacked = (Target(up.name, (0.0, 0.0, height), low.name) for low, up in itertools.pairwise(blocks))
    targets = (task.targets[0], *stacked)
    return _limited(
        dataclasses.replace(task, name=f"tower-of-{count}", objects=blocks, kits=task.kits[:1], targets=targets)
    )


def kit(count: int) -> Task:
    """Return the task of the first so many targets of `kit12`, with their objects and slots."""
    task = load_task("kit12")
    objects, targets = task.objects[:count], task.targets[:count]
    wanted = {target.slot for target in targets}
    kits = tuple(
        dataclasses.replace(one, slots=tuple(slot for slot in one.slots if f"{one.name}.{slot.name}" in wanted))
        for one in task.kits
    )
    return _limited(dataclasses.replace(task, name=f"kit-of-{count}", objects=objects, kits=kits, targets=targets))


def named(name: str) -> Task:
    """Return the task called `tower-of-N` or `kit-of-N`, or else one of the package or of a file."""
    if generated := re.fullmatch(r"(tower|kit)-of-(\d+)", name):
        return {"tower": tower, "kit": kit}[generated[1]](int(generated[2]))
    return load_task(name)


def _limited(task: Task) -> Task:
    """Return the task with as many ticks as one that is read from a file."""
    ticks = max(LEAST_TICKS, TICKS_PER_TARGET * len(task.targets))
    return dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=ticks))
