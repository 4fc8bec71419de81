"""The next demonstration that would answer open questions: a start in which the answers part most."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.lfd.learning import Lesson
from bt_jax.lfd.questions import Question, task_of
from bt_jax.lfd.rehearsal import MOST, parting, rehearse
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World, headings, take
from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import kit_origin

__all__ = ["Proposal", "propose"]

PROPOSED = 1 << 24  # seeds of the layouts that are searched; nothing else uses them
SEARCHED = 48  # layouts


@dataclasses.dataclass(frozen=True)
class Proposal:
    """A start in which to demonstrate next: a state (a batch of one, NumPy), and the `task` that always starts so. `parted`
    says for each question how far its two closest answers are apart there, in tolerances of the task, at most `MOST`."""

    start: World
    task: Task
    parted: tuple[float, ...]


def propose(lesson: Lesson, questions: tuple[Question, ...], *, seed: int = 0, searched: int = SEARCHED) -> Proposal:
    """Return the start of the demonstration that would answer most of the open questions of a lesson, of so many random
    layouts of its task. Raise UserError if there are none.

    Every answer is run in every layout. That layout is taken in which the fewest answers to a question do the same, then
    in which most of them work, and then in which they part most.
    """
    if not questions:
        raise UserError("the demonstrations leave nothing open; no other one is needed")
    task = lesson.task
    layouts = sample_layouts(task, [PROPOSED, seed], searched)
    apart, works = np.zeros((searched, len(questions))), np.zeros(searched)
    known = {}
    for q, question in enumerate(questions):
        for answer in question.answers:
            if answer.lesson.tree not in known:
                known[answer.lesson.tree] = rehearse(answer.lesson.tree, task_of(answer.lesson), layouts)
        shown = [known[answer.lesson.tree] for answer in question.answers]
        for k in range(searched):
            pairs = itertools.combinations([one[k] for one in shown], 2)
            apart[k, q] = min(parting(one, other, task) for one, other in pairs)
            works[k] += sum(one[k].ending == Ending.SUCCESS for one in shown)
    clear = np.minimum(apart, MOST)
    best = max(range(searched), key=lambda k: (int((clear[k] >= MOST / 2).sum()), works[k], clear[k].sum()))
    start = take(layouts, slice(best, best + 1))
    return Proposal(start, _starting(task, start), tuple(clear[best].tolist()))


def _starting(task: Task, start: World) -> Task:
    """Return the task that always starts in a state."""
    table = min(task.tables, key=lambda one: _off(task, one, start))
    places = []
    for thing, pose in zip(task.objects, start.poses[0], strict=True):
        x, y, z = (round(a - b, 4) + 0.0 for a, b in zip(pose[:3].tolist(), task.robot_position, strict=True))
        turn = round(math.degrees(float(headings(pose[3:]))), 2) if thing.symmetry else 0.0
        places.append(Target(thing.name, (x, y, z), task.robot_frame, turn or None))
    layout = dataclasses.replace(task.layout, kit=table.name, stack=(), fixed=tuple(places), turn=0.0)
    return dataclasses.replace(task, layout=layout)


def _off(task: Task, table: Table, start: World) -> float:
    """Return how far the kits are from where they would be with those that name no table on this one [m]."""
    origins = np.array([kit_origin(task, table, name) for name in task.kit_names])
    return float(np.abs(origins - start.kits[0]).sum())
