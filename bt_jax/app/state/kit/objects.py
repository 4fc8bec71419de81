"""Objects of a kit that a person adds, copies, removes, names, sizes and colours. Lengths are metres.

What is changed goes by its name, or by that of its part. What cannot be is refused with a UserError; what can be shown
but not done is left to `bt_jax.tasks.problems`.
"""

from __future__ import annotations

import dataclasses

from bt_jax._util.errors import UserError
from bt_jax.app.state.kit.references import check_name, check_numbers, stem_of, taken_names, unused_name, with_names
from bt_jax.tasks import Object, Target, Task
from bt_jax.tasks.checks import MOST_OBJECTS
from bt_jax.tasks.slots import slot_position, slot_turn, slots_by_name
from bt_jax.tasks.things import Shape, Vec3

__all__ = ["COLORS", "add_object", "copy_object", "count_object", "remove_object", "rename_object", "shape_object"]

COLORS: tuple[Vec3, ...] = (  # the next one that no object has is that of a new one
    (0.95, 0.75, 0.1),
    (0.15, 0.6, 0.3),
    (0.15, 0.4, 0.8),
    (0.75, 0.15, 0.15),
    (0.85, 0.45, 0.15),
    (0.5, 0.3, 0.65),
    (0.2, 0.65, 0.7),
    (0.6, 0.62, 0.66),
)
WIDTH = 2 / 3  # of the first object of a shape, as a part of what fits the gripper
STEM = {"cuboid": "Box", "cylinder": "Can"}


def add_object(task: Task, shape: Shape) -> tuple[Task, str]:
    """Return the task with one more object, as large as the last one of its shape, and its name."""
    _check_room(task, 1)
    name = unused_name(STEM[shape], taken_names(task))
    width = round(WIDTH * task.gripper_opening, 3)
    like = [one.size for one in task.objects if one.shape == shape]
    thing = Object(name, like[-1] if like else (width, width, width), _color(task), shape=shape)
    return dataclasses.replace(task, objects=(*task.objects, thing)), name


def copy_object(task: Task, kind: str) -> tuple[Task, str]:
    """Return the task with another object, or part, like one that it has, and its name."""
    same = [task.thing(name) for name in task.instances[kind]]
    _check_room(task, len(same))
    taken = taken_names(task)
    name = unused_name(stem_of(kind), taken)
    color = _color(task)
    copies = _named([dataclasses.replace(one, color=color) for one in same], name, part=bool(same[0].part))
    for one in copies:
        if one.name in taken:
            raise UserError(f"something else is called {one.name}; rename it first")
    return dataclasses.replace(task, objects=(*task.objects, *copies)), name


def remove_object(task: Task, kind: str) -> Task:
    """Return the task without an object or a part. Raise UserError if there would be nothing left."""
    gone = task.instances[kind]
    left = tuple(thing for thing in task.objects if thing.name not in gone)
    if not left:
        raise UserError(f"{kind} is all that there is to move; add something else first")
    names = dict.fromkeys((kind, *gone))
    return dataclasses.replace(with_names(task, names, names), objects=left)


def rename_object(task: Task, kind: str, name: str) -> Task:
    """Return the task in which an object or a part is called otherwise."""
    check_name(task, name, kind)
    return _replaced(
        task, kind, name, [task.thing(one) for one in task.instances[kind]], part=task.thing(kind).part != ""
    )


def count_object(task: Task, kind: str, count: int) -> Task:
    """Return the task with so many of an object, which are a part, interchangeable, if they are several."""
    same = [task.thing(name) for name in task.instances[kind]]
    if count < 1:
        raise UserError(f"{count} of {kind} are too few; remove it instead")
    _check_room(task, count - len(same))
    return _replaced(task, kind, kind, [*same, *[same[-1]] * count][:count], part=count > 1)


def shape_object(
    task: Task, kind: str, *, size: Vec3 | None = None, shape: Shape | None = None, color: Vec3 | None = None
) -> Task:
    """Return the task with an object or a part of another size, shape or colour. What stands on it, and where it should be,
    rises or sinks with its height; a cylinder is as deep as it is wide."""
    before = task.thing(kind)
    shape, size = shape or before.shape, size or before.size
    if shape == "cylinder":
        size = size[0], size[0], size[2]
    like = dataclasses.replace(before, size=size, shape=shape, color=color or before.color)
    objects = tuple(
        dataclasses.replace(like, name=one.name) if one.name in task.instances[kind] else one for one in task.objects
    )
    higher = (size[2] - before.height) / 2
    is_round = shape == "cylinder"

    def target(one: Target) -> Target:
        own, below = one.object in (kind, *task.instances[kind]), one.frame in task.instances[kind]
        x, y, z = one.position
        raised = dataclasses.replace(one, position=(x, y, round(z + higher * (own + below), 6)))
        return dataclasses.replace(raised, turn=None) if own and is_round else raised

    layout = dataclasses.replace(task.layout, fixed=tuple(map(target, task.layout.fixed)))
    new = dataclasses.replace(task, objects=objects, targets=tuple(map(target, task.targets)), layout=layout)
    return check_numbers(in_slots(new))


def in_slots(task: Task) -> Task:
    """Return the task in which targets that name a slot are where the slot is; one whose slot has gone stays where it is."""
    slots = slots_by_name(task.kits)

    def target(one: Target) -> Target:
        if not one.slot:
            return one
        if one.slot not in slots:
            return dataclasses.replace(one, slot="")
        kit, slot = slots[one.slot]
        thing = task.thing(one.object)
        return Target(one.object, slot_position(kit, slot, thing), kit.name, slot_turn(kit, slot, thing), one.slot)

    return dataclasses.replace(task, targets=tuple(map(target, task.targets)))


def _replaced(task: Task, kind: str, name: str, things: list[Object], *, part: bool) -> Task:
    """Return the task with other objects in place of those of a kind, and without targets for more than there are."""
    old, new = task.instances[kind], _named(things, name, part=part)
    for one in new:
        if one.name in taken_names(task) - {kind, *old}:
            raise UserError(f"something else is called {one.name}; rename it first")
    now: dict[str, str | None] = dict.fromkeys(old) | {a: b.name for a, b in zip(old, new, strict=False)}
    # Where one becomes several, its targets and slots mean any of them.
    changed = with_names(task, now, {} if part and kind in old else now | {kind: name})
    first = task.object_names.index(old[0])
    others = [thing for thing in task.objects if thing.name not in old]
    changed = dataclasses.replace(changed, objects=(*others[:first], *new, *others[first:]))
    own = [target for target in changed.targets if target.object in (name, *changed.instances[name])]
    surplus = own[len(new) :]
    return dataclasses.replace(changed, targets=tuple(one for one in changed.targets if one not in surplus))


def _named(things: list[Object], name: str, *, part: bool) -> list[Object]:
    if not part:
        return [dataclasses.replace(things[0], name=name, part="")]
    return [dataclasses.replace(one, name=f"{name}{i}", part=name) for i, one in enumerate(things, start=1)]


def _check_room(task: Task, more: int) -> None:
    if len(task.objects) + more > MOST_OBJECTS:
        raise UserError(f"{len(task.objects) + more} objects are too many; use {MOST_OBJECTS} or fewer")


def _color(task: Task) -> Vec3:
    used = [thing.color for thing in task.objects]
    return min(COLORS, key=used.count)
