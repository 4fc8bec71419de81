"""Whether a task is valid: names, sizes, places and targets that go together."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from types import MappingProxyType
from typing import NoReturn

from bt_jax._util.errors import UserError
from bt_jax.tasks.bounds import out_of_bounds
from bt_jax.tasks.support import unsupported
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Kit, Vec3
from bt_jax.tasks.written import Keys

__all__ = ["check", "check_support"]

NO_KEYS: Keys = MappingProxyType({})
Fail = Callable[[str, str, str], NoReturn]  # key, problem, remedy

RESERVED = ("floor", "gripper", "kit", "metal", "nothing", "plate", "rubber", "sky", "table", "wall_back", "wall_front",
            "wall_left", "wall_right")  # fmt: skip


def check(task: Task, source: str, keys: Keys = NO_KEYS) -> None:
    """Raise UserError, naming `source`, key and remedy, if a task is invalid; `keys` says how the file names its keys."""
    fail = functools.partial(_fail, source, keys)
    names = [*task.frames, *(table.name for table in task.tables)]
    if not re.fullmatch(r"[\w-]+", task.name):
        fail("name", f"'{task.name}' is not a name", "use letters, digits, underscores and dashes")
    for name in names:
        if name in RESERVED:
            fail("objects", f"the name '{name}' is reserved for the scene", "choose another")
        if not name.isidentifier():
            fail("objects", f"'{name}' is not a name", "use letters, digits and underscores")
        if names.count(name) > 1:
            fail("objects", f"two things are called '{name}'", "rename one of them")
    if not task.objects:
        fail("objects", "there is nothing to move", "add at least one box")
    if not task.kits:
        fail("kits", "there is no kit", "add at least one")
    if not task.tables:
        fail("tables", "there is nothing to stand on", "add at least one table")
    if not task.targets:
        fail("targets", "there is nothing to do", "add at least one target")
    for i, subgoal in enumerate(task.subgoals):
        if not subgoal.name.isidentifier():
            fail(f"subgoals[{i}].name", f"'{subgoal.name}' is not a name", "use letters, digits and underscores")
        if subgoal.name in [other.name for other in task.subgoals[:i]]:
            fail(f"subgoals[{i}].name", f"'{subgoal.name}' is listed twice", "rename one of them")
        if not subgoal.conditions:
            fail(f"subgoals[{i}].conditions", "it has no conditions", "add a condition, for instance clear(YellowBox)")
    for key, complaint in out_of_bounds(task):
        raise UserError(f"{source}, key {_as_written(key, keys)}: {complaint}")
    _check_sizes(task, fail)
    _check_layout(task, fail)
    _check_targets(task, fail)


def check_support(task: Task, source: str) -> None:
    """Raise UserError, naming `source`, key and remedy, for a target in the air or inside a table."""
    for i, z in unsupported(task):
        problem = f"nothing can be under {task.targets[i].object} there, which must rest on something"
        _fail(source, NO_KEYS, f"targets[{i}].position", problem, f"write {round(z, 4):g} for z, or another place")


def _check_sizes(task: Task, fail: Fail) -> None:
    for i, thing in enumerate(task.objects):
        narrow, wide = sorted(thing.size[:2])
        if narrow > task.gripper_opening:
            fail(
                f"objects[{i}].size",
                f"{narrow} m does not fit the gripper, which opens {task.gripper_opening} m",
                "make the box smaller or gripper_opening larger",
            )
        inner = [2 * min(kit.inner) for kit in task.kits]
        if not any(narrow <= 2 * min(kit.inner) and wide <= 2 * max(kit.inner) for kit in task.kits):
            fail(
                f"objects[{i}].size",
                f"{wide} m does not fit in the kit, {max(inner):.3f} m between the walls",
                "make the box smaller or kit.size larger",
            )
    for i, kit in enumerate(task.kits):
        if min(kit.inner) <= 0:
            fail(f"kits[{i}].wall_thickness", "the walls leave no room", "make the walls thinner or the kit larger")
        for table in task.tables:
            if (kit.table or task.layout.kit) in ("random", table.name) and any(
                a > b for a, b in zip(kit.size, table.size, strict=False)
            ):
                fail(
                    f"kits[{i}].size",
                    f"{' x '.join(f'{edge:g}' for edge in dict.fromkeys(kit.size))} m is wider than {table.name}",
                    "make the kit smaller or the table larger",
                )


def _check_layout(task: Task, fail: Fail) -> None:
    tables = [table.name for table in task.tables]
    if task.layout.kit != "random" and task.layout.kit not in tables:
        fail("layout.kit", f"there is no table '{task.layout.kit}'", f"use random or one of {', '.join(tables)}")
    if len(task.tables) < 2:
        fail("tables", "the kit takes one table and the boxes need another", "add a table")
    for name in task.layout.stack:
        if name not in task.object_names:
            fail("layout.stack", f"there is no box '{name}'", f"use some of {', '.join(task.object_names)}")
    if len(set(task.layout.stack)) < len(task.layout.stack):
        fail("layout.stack", "a box is listed twice", "name each box once")
    _check_fixed(task, fail)
    free = [[edge - 2 * task.layout.margin for edge in table.size[:2]] for table in task.tables]
    if min(map(min, free)) < 0:
        fail("layout.margin", f"{task.layout.margin} m from every edge leaves nothing of a table", "lower it")
    if not task.layout.spacing:
        return
    # Half of what a square lattice would hold: then random placement finds room without trying long.
    lattices = [math.prod(1 + int(edge / task.layout.spacing) for edge in edges) for edges in free[1:]]
    loose = len(task.objects) - len(task.layout.fixed)
    if sum(max(1, lattice // 2) for lattice in lattices) < loose:
        fail(
            "layout.spacing",
            f"{loose} boxes do not fit {task.layout.spacing} m apart on the tables",
            "lower spacing or margin, or add tables",
        )


def _check_fixed(task: Task, fail: Fail) -> None:
    halves = {thing.name: thing.half_at(None) for thing in task.objects}
    fixed = task.layout.fixed
    if fixed and task.layout.kit == "random" and any(not kit.table for kit in task.kits):
        fail("layout.kit", "the kit may be placed where a box is fixed", "name the kit's table")
    for i, place in enumerate(fixed):
        key = f"layout.fixed[{i}]"
        if place.object not in halves:
            fail(f"{key}.object", f"there is no box '{place.object}'", f"use one of {', '.join(halves)}")
        if place.object in task.layout.stack or place.object in [other.object for other in fixed[:i]]:
            fail(f"{key}.object", f"{place.object} has a place already", "give each box one place")
        if place.frame != task.robot_frame:
            fail(f"{key}.frame", f"'{place.frame}' is not the robot's frame", f"use {task.robot_frame}")
        half, slack = task.thing(place.object).half_at(place.turn), 0.2 * halves[place.object][2]
        for other in fixed[:i]:
            beyond = task.thing(other.object).half_at(other.turn)
            if _overlap(half, place.position, beyond, other.position) > slack:
                fail(f"{key}.position", f"{place.object} would be inside {other.object}", "move it to free space")
        x, y, z = (a + b for a, b in zip(place.position, task.robot_position, strict=True))
        under = [
            t
            for t in task.tables
            if abs(x - t.position[0]) <= t.size[0] / 2 and abs(y - t.position[1]) <= t.size[1] / 2
        ]
        if not any(z - half[2] > table.top - slack for table in under):
            fail(f"{key}.position", f"{place.object} would not be over a table", "move it over one")


def _overlap(half: Vec3, position: Vec3, other_half: Vec3, other_position: Vec3) -> float:
    """Return by how much two blocks overlap, along the axis on which that is the least; negative if they do not."""
    halves = zip(half, other_half, position, other_position, strict=True)
    return min(a + b - abs(x - y) for a, b, x, y in halves)


def _check_targets(task: Task, fail: Fail) -> None:
    rests_on: dict[str, str] = {}
    counts: dict[str, int] = {}
    kits = {kit.name: kit for kit in task.kits}
    for i, target in enumerate(task.targets):
        key = f"targets[{i}]"
        if target.object not in task.instances:
            fail(f"{key}.object", f"there is no box '{target.object}'", f"use one of {', '.join(task.kinds)}")
        if target.frame not in task.frames:
            fail(f"{key}.frame", f"there is no frame '{target.frame}'", f"use one of {', '.join(task.frames)}")
        counts[target.object] = counts.get(target.object, 0) + 1
        if counts[target.object] > (most := len(task.instances[target.object])):
            remedy = "give each box one target" if most == 1 else "raise its count or drop a target"
            there = (
                f"{target.object} has a target already" if most == 1 else f"there are only {most} of {target.object}"
            )
            fail(f"{key}.object", there, remedy)
        rests_on[target.object] = target.frame
        half = task.thing(target.object).half_at(target.turn)
        if target.frame in kits and _hits_kit(kits[target.frame], target.position, half):
            fail(
                f"{key}.position", f"{target.object} would be inside the kit's walls or plate", "move it to free space"
            )
        if target.frame in task.object_names and target.frame != target.object:
            below = task.thing(target.frame).half_at(None)
            if _overlap(half, target.position, below, (0.0, 0.0, 0.0)) > task.episode.tolerance:
                fail(f"{key}.position", f"{target.object} would be inside {target.frame}", "move it to free space")
    for start in rests_on:
        seen, frame = [start], rests_on[start]
        while frame in rests_on or frame == start:
            if frame in seen:
                fail(
                    "targets",
                    f"circular: {' in the frame of '.join([*seen, frame])}",
                    "give one of them a position in the kit or the robot's frame",
                )
            seen.append(frame)
            frame = rests_on[frame]
    for i, target in enumerate(task.targets):
        if any(target.frame == other.frame and target.position == other.position for other in task.targets[:i]):
            fail(f"targets[{i}]", f"{target.object} would be where another box should be", "move one of them")


def _hits_kit(kit: Kit, position: Vec3, half: Vec3) -> bool:
    slack = 0.005
    x, y, bottom = abs(position[0]), abs(position[1]), position[2] - half[2]
    over_plate = x < kit.half[0] + half[0] and y < kit.half[1] + half[1]
    if over_plate and bottom < kit.plate - slack:
        return True
    low = bottom < kit.rim - slack
    inside = x + half[0] <= kit.inner[0] and y + half[1] <= kit.inner[1]
    outside = x - half[0] >= kit.half[0] or y - half[1] >= kit.half[1]
    return low and not inside and not outside


def _as_written(key: str, keys: Keys) -> str:
    """Return a key as the file has it."""
    begin = max((old for old in keys if re.match(rf"{re.escape(old)}(?![\w[])", key)), key=len, default="")
    return keys.get(begin, "") + key.removeprefix(begin)


def _fail(source: str, keys: Keys, key: str, problem: str, remedy: str) -> NoReturn:
    raise UserError(f"{source}, key {_as_written(key, keys)}: {problem}; {remedy}")
