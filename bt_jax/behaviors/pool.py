"""What evolution may draw from in a task."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from bt_jax.behaviors.symbols import CLOSED, NOTHING, OPEN, Behavior
from bt_jax.behaviors.vocabulary import Vocabulary
from bt_jax.tasks.slots import fits, slot_position, slot_turn
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Object, Vec3

__all__ = ["gene_pool"]


def gene_pool(task: Task) -> Vocabulary[Behavior]:
    """Return what evolution may use in a task.

    These are gripper conditions and actions, a `reached` condition for each subgoal, and one `move` gene for each object or
    part and each place (57 in the published scene). Places are beside and on top of every other object that can carry it,
    and in the kits the slots that may take it and the grid of the task's gene settings: in kits without slots, and for what
    no slot takes in all; each with every turn in which the object looks different there.
    """
    conditions = [Behavior("gripper", (OPEN,)), Behavior("gripper", (CLOSED,)), Behavior("holding", (NOTHING,))]
    conditions += [Behavior("reached", (subgoal.name,)) for subgoal in task.subgoals]
    actions = [Behavior("open_gripper"), Behavior("close_gripper")]
    genes = [Behavior("move", (name, *place)) for name in task.kinds for place in _places(task, name)]
    return Vocabulary.of([*conditions, *actions, *genes])


Place = tuple[Vec3, str] | tuple[Vec3, str, float]  # position, frame, and a turn in degrees unless all are alike


def _places(task: Task, name: str) -> Iterator[Place]:
    """Yield where a gene may put an object or an instance of a part."""
    thing, settings = task.thing(name), task.genes
    for other in task.objects:
        if other.part or other.name == name:
            continue
        for turn in _turns(thing):
            half, own = thing.half_at(turn), other.half_at(None)
            level = half[2] - own[2]
            for axis, side in ((0, -1), (0, 1), (1, -1), (1, 1)):
                beside = side * (half[axis] + own[axis] + settings.gap)
                yield _place(beside if axis == 0 else 0.0, beside if axis == 1 else 0.0, level, other.name, turn)
            if _carries(other, thing, turn):
                yield _place(0.0, 0.0, half[2] + own[2], other.name, turn)
    slots = [[slot for slot in kit.places if fits(kit, slot, thing)] for kit in task.kits]
    for kit, fitting in zip(task.kits, slots, strict=True):
        for slot in fitting:
            yield _place(*slot_position(kit, slot, thing), kit.name, slot_turn(slot, thing))
        if kit.places and any(slots):
            continue
        cubes = task.all_cubes
        height = settings.height if cubes else kit.plate + thing.height / 2
        steps = [settings.pitch * (i - (settings.grid - 1) / 2) for i in range(settings.grid)]
        for turn in _turns(thing):
            half = thing.half_at(turn)
            for x, y in itertools.product(steps, steps):
                if cubes or (abs(x) + half[0] <= kit.inner[0] and abs(y) + half[1] <= kit.inner[1]):
                    yield _place(x, y, height, kit.name, turn)


def _turns(thing: Object) -> tuple[float | None, ...]:
    """Return the right-angled turns in which an object looks different; of cubes and cylinders one, that does not matter."""
    return (0.0, 90.0) if thing.symmetry == 180 else (None,)


def _carries(below: Object, above: Object, turn: float | None) -> bool:
    """Return whether an object stays on the middle of another: more than half of it along each axis has a face below."""
    return all(a < 2 * b for a, b in zip(above.half_at(turn)[:2], below.half_at(None)[:2], strict=True))


def _place(x: float, y: float, z: float, frame: str, turn: float | None) -> Place:
    position = (round(x, 6) + 0.0, round(y, 6) + 0.0, round(z, 6) + 0.0)
    return (position, frame) if turn is None else (position, frame, turn)
