"""What evolution may draw from in a task."""

from __future__ import annotations

from bt_jax.behaviors.symbols import CLOSED, NOTHING, OPEN, Behavior
from bt_jax.behaviors.vocabulary import Vocabulary
from bt_jax.tasks.task import Task, Vec3

__all__ = ["gene_pool"]


def gene_pool(task: Task) -> Vocabulary[Behavior]:
    """Return what evolution may use in a task.

    These are gripper conditions and actions, a `reached` condition for each subgoal, and one `move` gene for each box and
    each place that the task's gene settings define (57 in the published scene).
    """
    conditions = [Behavior("gripper", (OPEN,)), Behavior("gripper", (CLOSED,)), Behavior("holding", (NOTHING,))]
    conditions += [Behavior("reached", (subgoal.name,)) for subgoal in task.subgoals]
    actions = [Behavior("open_gripper"), Behavior("close_gripper")]
    genes = [
        Behavior("move", (box.name, position, frame))
        for box in task.boxes
        for frame, position in _places(task, box.name, box.size)
    ]
    return Vocabulary.of([*conditions, *actions, *genes])


def _places(task: Task, name: str, size: float) -> list[tuple[str, Vec3]]:
    settings = task.genes
    places: list[tuple[str, Vec3]] = []
    for other in task.boxes:
        if other.name == name:
            continue
        middle = (size + other.size) / 2
        beside = middle + settings.gap
        level = (size - other.size) / 2
        for x, y, z in (
            (-beside, 0.0, level),
            (beside, 0.0, level),
            (0.0, -beside, level),
            (0.0, beside, level),
            (0.0, 0.0, middle),
        ):
            places.append((other.name, _rounded(x, y, z)))
    steps = [settings.pitch * (i - (settings.grid - 1) / 2) for i in range(settings.grid)]
    places += [(task.kit.name, _rounded(x, y, settings.height)) for x in steps for y in steps]
    return places


def _rounded(x: float, y: float, z: float) -> Vec3:
    return round(x, 6) + 0.0, round(y, 6) + 0.0, round(z, 6) + 0.0
