"""What evolution may draw from in a task."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

from bt_jax.behaviors.nodes import Decorator, Kind
from bt_jax.behaviors.symbols import CLOSED, NOTHING, OPEN, Behavior
from bt_jax.behaviors.vocabulary import Vocabulary
from bt_jax.tasks.slots import fits, slot_position, slot_turn
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Object, Vec3

__all__ = ["gene_pool", "placing_gene"]

RETRIES = (3, 10, 30)  # failures up to which evolution may retry a subtree, and
TIMEOUTS = (5, 20)  # ticks after which it may give one up, where things go wrong


def gene_pool(task: Task) -> Vocabulary[Behavior]:
    """Return what evolution may use in a task.

    These are gripper conditions and actions, a `reached` condition for each subgoal, and one gene for each object or part
    and each place (57 in the published scene): `move`, or `carry` where the robot drives. Places are beside and on top of
    every other object that can carry it, and in the kits the slots that may take it and the grid of the task's gene
    settings: in kits without slots, and for what no slot takes in all; each with every turn in which the object looks
    different there: of what stands on a square one, if a target says how it is turned. An instance of a part has genes of
    its own, and is a frame, if a target or a subgoal names it.

    Where things go wrong, `is_seen` and `look` of each object or part join, and the decorators retry and timeout.
    """
    conditions = [Behavior("gripper", (OPEN,)), Behavior("gripper", (CLOSED,)), Behavior("holding", (NOTHING,))]
    conditions += [Behavior("reached", (subgoal.name,)) for subgoal in task.subgoals]
    actions = [Behavior("open_gripper"), Behavior("close_gripper")]
    named = _named(task)
    decorators: list[Decorator] = []
    if task.faults is not None:
        seen = [(name,) for name in (*task.kinds, *named)]
        conditions += [Behavior("is_seen", name) for name in seen]
        actions += [Behavior("look", name) for name in seen]
        decorators += [Decorator(Kind.RETRY, number) for number in RETRIES]
        decorators += [Decorator(Kind.TIMEOUT, number) for number in TIMEOUTS]
    gene = placing_gene(task)
    genes = [Behavior(gene, (name, *place)) for name in (*task.kinds, *named) for place in _places(task, name, named)]
    return Vocabulary.of([*conditions, *actions, *genes], decorators)


def placing_gene(task: Task) -> str:
    """Return the name of the gene that puts an object at a place: `carry` where the robot drives, else `move`."""
    return "move" if task.robot.base is None else "carry"


Place = tuple[Vec3, str] | tuple[Vec3, str, float]  # position, frame, and a turn in degrees unless all are alike


def _named(task: Task) -> tuple[str, ...]:
    """Return the instances of parts that a target or a subgoal names."""
    names = {name for target in task.targets for name in (target.object, target.frame)}
    names |= {word for subgoal in task.subgoals for text in subgoal.conditions for word in re.findall(r"\w+", text)}
    return tuple(thing.name for thing in task.objects if thing.part and thing.name in names)


def _places(task: Task, name: str, named: tuple[str, ...]) -> Iterator[Place]:
    """Yield where a gene may put an object or an instance of a part; of the instances, those that are named are frames."""
    thing, settings, turns = task.thing(name), task.genes, _turns(task, name)
    for other in task.objects:
        if (other.part and other.name not in named) or other.name == name:
            continue
        for turn in turns:
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
            yield _place(*slot_position(kit, slot, thing), kit.name, slot_turn(kit, slot, thing) or turns[0])
        if kit.places and any(slots):
            continue
        cubes = task.all_cubes
        height = kit.plate + thing.height / 2 if settings.height is None else settings.height
        steps = [settings.pitch * (i - (settings.grid - 1) / 2) for i in range(settings.grid)]
        for turn in turns:
            half = thing.half_at(turn)
            for x, y in itertools.product(steps, steps):
                if cubes or (abs(x) + half[0] <= kit.inner[0] and abs(y) + half[1] <= kit.inner[1]):
                    yield _place(x, y, height, kit.name, turn)


def _turns(task: Task, name: str) -> tuple[float | None, ...]:
    """Return the right-angled turns in which an object looks different: None for a cylinder, and for what stands on a square
    unless a target says how it is turned."""
    thing = task.thing(name)
    if thing.symmetry == 180:
        return 0.0, 90.0
    meant = set(task.instances[name])
    turned = [target for target in task.targets if target.turn is not None]
    return (None,) if all(meant.isdisjoint(task.instances[target.object]) for target in turned) else (0.0,)


def _carries(below: Object, above: Object, turn: float | None) -> bool:
    """Return whether an object stays on the middle of another: more than half of it along each axis has a face below."""
    return all(a < 2 * b for a, b in zip(above.half_at(turn)[:2], below.half_at(None)[:2], strict=True))


def _place(x: float, y: float, z: float, frame: str, turn: float | None) -> Place:
    position = (round(x, 6) + 0.0, round(y, 6) + 0.0, round(z, 6) + 0.0)
    return (position, frame) if turn is None else (position, frame, turn)
