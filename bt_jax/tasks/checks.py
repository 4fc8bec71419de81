"""Whether a task is valid: names, sizes, places and targets that go together."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import MappingProxyType
from typing import NoReturn

from bt_jax._util.errors import UserError
from bt_jax.tasks.base_checks import check_base
from bt_jax.tasks.bounds import out_of_bounds
from bt_jax.tasks.kit_checks import KIT_RULES, check_kit_names
from bt_jax.tasks.refusals import Fail, Problem, as_written, refusal
from bt_jax.tasks.start_checks import LAYOUT_RULES, check_layout_names
from bt_jax.tasks.support import unsupported
from bt_jax.tasks.target_checks import TARGET_RULES, check_target_names
from bt_jax.tasks.task import Task
from bt_jax.tasks.written import Keys

__all__ = ["check", "check_support", "problems"]

NO_KEYS: Keys = MappingProxyType({})
MOST_OBJECTS, MOST_KITS = 16, 4

RESERVED = MappingProxyType({"nothing": "for `holding(nothing)`", "world": "for the scene"})


def check(task: Task, source: str, keys: Keys = NO_KEYS, *, unfinished: bool = False) -> None:
    """Raise UserError, naming `source`, key and remedy, if a task is invalid; `keys` says how the file names its keys.

    An unfinished task may have what `problems` finds: it can be shown, and not be done."""
    fail = refusal(source, keys)
    if not task.objects:
        fail("objects", "there is nothing to move", "add at least one object")
    if not task.kits:
        fail("kits", "there is no kit", "add at least one")
    if not task.tables:
        fail("tables", "there is nothing to stand on", "add at least one table")
    if not unfinished:
        _check_goal(task, fail)
    if len(task.objects) > MOST_OBJECTS:
        fail("objects", f"{len(task.objects)} objects are too many", f"use {MOST_OBJECTS} or fewer")
    if len(task.kits) > MOST_KITS:
        fail("kits", f"{len(task.kits)} kits are too many", f"use {MOST_KITS} or fewer")
    _check_names(task, fail)
    for key, complaint in out_of_bounds(task):
        raise UserError(f"{source}, key {as_written(key, keys)}: {complaint}")
    _check_objects(task, fail)
    check_kit_names(task, fail)
    check_layout_names(task, fail)
    check_target_names(task, fail)
    _check_faults(task, fail)
    for rule in () if unfinished else RULES:
        rule(task, fail)


def check_support(task: Task, source: str) -> None:
    """Raise UserError, naming `source`, key and remedy, for a target in the air or inside a table."""
    _check_support(task, refusal(source, NO_KEYS))


def problems(task: Task) -> list[Problem]:
    """Return why a task cannot be done that `check` takes for an unfinished one: the first problem by each rule."""
    found = []
    for rule in (_check_goal, *RULES, _check_support):
        try:
            rule(task, _found)
        except _Found as stopped:
            found.append(stopped.problem)
    return found


class _Found(Exception):
    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        self.problem = problem


def _found(key: str, problem: str, remedy: str) -> NoReturn:
    raise _Found(Problem(key, problem, remedy))


def _check_goal(task: Task, fail: Fail) -> None:
    if not task.targets:
        fail("targets", "there is nothing to do", "add at least one target")


def _check_support(task: Task, fail: Fail) -> None:
    for i, z in unsupported(task):
        problem = f"nothing can be under {task.targets[i].object} there, which must rest on something"
        fail(f"targets[{i}].position", problem, f"write {round(z, 4):g} for z, or another place")


def _names(task: Task) -> Iterator[tuple[str, str, str]]:
    """Yield the key, the name and the kind of everything that has a name."""
    for table in task.tables:
        yield f"tables[{task.tables.index(table)}].name", table.name, "a table"
    yield "robot_frame", task.robot_frame, "the robot's frame"
    for i, kit in enumerate(task.kits):
        yield f"kits[{i}].name", kit.name, "a kit"
    parts: set[str] = set()
    for i, thing in enumerate(task.objects):
        if thing.part and thing.part not in parts:
            yield f"objects[{i}].part", thing.part, "a part"
            parts.add(thing.part)
        key = f"objects[{i}].{'part' if thing.part else 'name'}"
        yield key, thing.name, f"an instance of the part {thing.part}" if thing.part else "an object"


def _check_names(task: Task, fail: Fail) -> None:
    if not re.fullmatch(r"[\w-]+", task.name):
        fail("name", f"'{task.name}' is not a name", "use letters, digits, underscores and dashes")
    kinds: dict[str, str] = {}
    for key, name, kind in _names(task):
        if name in RESERVED:
            fail(key, f"the name '{name}' is reserved {RESERVED[name]}", "choose another")
        if not name.isidentifier():
            fail(key, f"'{name}' is not a name", "use letters, digits and underscores")
        if name in kinds:
            both = f"two of them are called '{name}'" if kinds[name] == kind else f"'{name}' is also {kinds[name]}"
            fail(key, both, "rename one of them")
        kinds[name] = kind
    for i, subgoal in enumerate(task.subgoals):
        if not subgoal.name.isidentifier():
            fail(f"subgoals[{i}].name", f"'{subgoal.name}' is not a name", "use letters, digits and underscores")
        if subgoal.name in [other.name for other in task.subgoals[:i]]:
            fail(f"subgoals[{i}].name", f"'{subgoal.name}' is listed twice", "rename one of them")
        if not subgoal.conditions:
            fail(f"subgoals[{i}].conditions", "it has no conditions", "add a condition, for instance clear(YellowBox)")


def _check_objects(task: Task, fail: Fail) -> None:
    for i, thing in enumerate(task.objects):
        alike = task.thing(thing.part or thing.name)
        if alike.body != thing.body:
            problem = f"{thing.name} is unlike {alike.name}, and instances of a part are interchangeable"
            fail(f"objects[{i}].size", problem, "give it the same size, shape and density, or another part")


def _check_sizes(task: Task, fail: Fail) -> None:
    inner = [2 * edge for kit in task.kits for edge in (min(kit.inner), max(kit.inner))]
    for i, thing in enumerate(task.objects):
        narrow, wide = sorted(thing.size[:2])
        is_round = thing.shape == "cylinder"
        key = f"objects[{i}].{'radius' if is_round else 'size'}"
        made = f"a radius of {narrow / 2:g} m makes it {narrow:g} m wide and" if is_round else f"{narrow:g} m"
        if narrow > task.gripper_opening:
            problem = f"{made} does not fit the gripper, which opens {task.gripper_opening} m"
            fail(key, problem, f"make {thing.name} {'thinner' if is_round else 'smaller'} or gripper_opening larger")
        if not any(narrow <= low and wide <= high for low, high in zip(inner[::2], inner[1::2], strict=True)):
            made = made if is_round else f"{wide:g} m"
            where = "the kit" if len(task.kits) == 1 else "any kit"
            problem = f"{made} does not fit in {where}, {max(inner):.3f} m between the walls"
            fail(key, problem, f"make {thing.name} smaller or kit.size larger")


def _check_faults(task: Task, fail: Fail) -> None:
    """Fail for faults of objects that the task does not have, and for probabilities that add up to more than 1."""
    faults = task.faults
    if faults is None:
        return
    for name in faults.objects:
        if name not in task.kinds:
            fail("faults.objects", f"there is no object '{name}'", f"use some of {', '.join(task.kinds)}")
    for first, second in (("slip", "jam"), ("drop", "jam"), ("move", "take")):
        total = getattr(faults, first) + getattr(faults, second)
        if total > 1:
            fail(
                f"faults.{first}", f"{first} and {second} add up to {total:g}, more than 1", "make one of them smaller"
            )


RULES = (*KIT_RULES, *LAYOUT_RULES, _check_sizes, *TARGET_RULES, check_base)  # what may stop a task that can be shown
