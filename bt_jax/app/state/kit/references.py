"""What names an object, a part or a kit, when that is renamed or removed."""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Container, Mapping
from string import ascii_uppercase

from bt_jax._util.errors import UserError
from bt_jax.tasks import Kit, Target, Task
from bt_jax.tasks.bounds import out_of_bounds

__all__ = ["check_name", "check_numbers", "stem_of", "taken_names", "unused_name", "with_names"]

Names = Mapping[str, str | None]  # by the name before; None for what has gone


def with_names(task: Task, things: Names, kinds: Names) -> Task:
    """Return the task in which everything that names an object, a part or a kit does so as they are called now.

    `things` are the names of what stands somewhere, `kinds` those of what is to be moved, an object or any of a part.
    Targets and starts of what has gone, or measured from it, and subgoals that name it, go, too. The objects and kits keep
    their names.
    """
    everything = {**things, **kinds}
    subgoals = [
        dataclasses.replace(subgoal, conditions=tuple(_renamed(one, everything) for one in subgoal.conditions))
        for subgoal in task.subgoals
        if not any(_mentions(one, old) for one in subgoal.conditions for old, new in everything.items() if new is None)
    ]
    faults = task.faults
    if faults is not None:
        left = tuple(name for name in (kinds.get(one, one) for one in faults.objects) if name is not None)
        # Faults that only what has gone had would now happen to everything.
        faults = None if faults.objects and not left else dataclasses.replace(faults, objects=left)
    stack = tuple(name for name in (things.get(one, one) for one in task.layout.stack) if name is not None)
    layout = dataclasses.replace(task.layout, stack=stack, fixed=_targets(task.layout.fixed, things, things))
    return dataclasses.replace(
        task,
        targets=_targets(task.targets, kinds, things),
        kits=tuple(_kit(kit, kinds) for kit in task.kits),
        layout=layout,
        subgoals=tuple(subgoals),
        faults=faults,
    )


def taken_names(task: Task) -> set[str]:
    """Return the names that nothing else may have."""
    return {
        *task.instances,
        *task.kit_names,
        *(table.name for table in task.tables),
        task.robot_frame,
        "nothing",
        "world",
    }


def unused_name(stem: str, taken: Container[str]) -> str:
    """Return the first of StemA, StemB, ..., StemAA, ... that is not taken: a number would look like that of an instance."""
    letters = (
        "".join(some) for count in itertools.count(1) for some in itertools.product(ascii_uppercase, repeat=count)
    )
    return next(name for name in (f"{stem}{letter}" for letter in letters) if name not in taken)


def stem_of(name: str) -> str:
    """Return a name without the letter or number that tells it from others of its kind: Box of BoxB, Bolt of Bolt2."""
    return re.sub(r"(?<=[a-z])([A-Z]|\d+)$", "", name)


def check_name(task: Task, name: str, before: str = "") -> None:
    """Raise UserError if an object, a part or a kit cannot be called so; it may keep the name `before`."""
    if not name.isidentifier():
        raise UserError(f"'{name}' is not a name; use letters, digits and underscores, and begin with a letter")
    if name != before and name in taken_names(task):
        raise UserError(f"something else is called {name}; choose another name")


def check_numbers(task: Task) -> Task:
    """Return the task. Raise UserError for a number that no object, kit or slot can have."""
    for _, complaint in out_of_bounds(task):
        raise UserError(complaint)
    return task


def _targets(targets: tuple[Target, ...], kinds: Names, things: Names) -> tuple[Target, ...]:
    found = []
    for target in targets:
        thing, frame = kinds.get(target.object, target.object), things.get(target.frame, target.frame)
        if thing is None or frame is None:
            continue
        slot = f"{frame}.{target.slot.partition('.')[2]}" if target.slot else ""
        found.append(dataclasses.replace(target, object=thing, frame=frame, slot=slot))
    return tuple(found)


def _kit(kit: Kit, names: Names) -> Kit:
    slots = [dataclasses.replace(slot, takes=names.get(slot.takes, slot.takes) or "") for slot in kit.slots]
    return dataclasses.replace(kit, slots=tuple(slots))


def _mentions(condition: str, name: str) -> bool:
    return re.search(rf"\b{re.escape(name)}\b", condition) is not None


def _renamed(condition: str, names: Names) -> str:
    return re.sub(r"[^\W\d]\w*", lambda word: names.get(word[0], word[0]) or word[0], condition)
