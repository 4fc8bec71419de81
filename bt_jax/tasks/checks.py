"""Whether a task is valid: names, sizes, places and targets that go together."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from typing import NoReturn

from bt_jax._util.errors import UserError
from bt_jax.tasks.bounds import out_of_bounds
from bt_jax.tasks.support import unsupported
from bt_jax.tasks.task import Kit, Task, Vec3

__all__ = ["check", "check_support"]

Fail = Callable[[str, str, str], NoReturn]  # key, problem, remedy

RESERVED = ("floor", "gripper", "kit", "metal", "nothing", "plate", "rubber", "sky", "table", "wall_back", "wall_front",
            "wall_left", "wall_right")  # fmt: skip


def check(task: Task, source: str) -> None:
    """Raise UserError, naming `source`, key and remedy, if a task is invalid."""
    fail = functools.partial(_fail, source)
    names = [*task.frames, *(table.name for table in task.tables)]
    if not re.fullmatch(r"[\w-]+", task.name):
        fail("name", f"'{task.name}' is not a name", "use letters, digits, underscores and dashes")
    for name in names:
        if name in RESERVED:
            fail("boxes", f"the name '{name}' is reserved for the scene", "choose another")
        if not name.isidentifier():
            fail("boxes", f"'{name}' is not a name", "use letters, digits and underscores")
        if names.count(name) > 1:
            fail("boxes", f"two things are called '{name}'", "rename one of them")
    if not task.boxes:
        fail("boxes", "there is nothing to move", "add at least one box")
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
        raise UserError(f"{source}, key {key}: {complaint}")
    _check_sizes(task, fail)
    _check_layout(task, fail)
    _check_targets(task, fail)


def check_support(task: Task, source: str) -> None:
    """Raise UserError, naming `source`, key and remedy, for a target in the air or inside a table."""
    for i, z in unsupported(task):
        problem = f"nothing can be under {task.targets[i].object} there, which must rest on something"
        _fail(source, f"targets[{i}].position", problem, f"write {round(z, 4):g} for z, or another place")


def _check_sizes(task: Task, fail: Fail) -> None:
    for i, box in enumerate(task.boxes):
        if box.size > task.gripper_opening:
            fail(
                f"boxes[{i}].size",
                f"{box.size} m does not fit the gripper, which opens {task.gripper_opening} m",
                "make the box smaller or gripper_opening larger",
            )
        if box.size > 2 * task.kit.inner:
            fail(
                f"boxes[{i}].size",
                f"{box.size} m does not fit in the kit, {2 * task.kit.inner:.3f} m between the walls",
                "make the box smaller or kit.size larger",
            )
    for table in task.tables:
        if task.kit.size > min(table.size[:2]):
            fail(
                "kit.size", f"{task.kit.size} m is wider than {table.name}", "make the kit smaller or the table larger"
            )
    if task.kit.inner <= 0:
        fail("kit.wall_thickness", "the walls leave no room", "make the walls thinner or the kit larger")


def _check_layout(task: Task, fail: Fail) -> None:
    tables = [table.name for table in task.tables]
    if task.layout.kit != "random" and task.layout.kit not in tables:
        fail("layout.kit", f"there is no table '{task.layout.kit}'", f"use random or one of {', '.join(tables)}")
    if len(task.tables) < 2:
        fail("tables", "the kit takes one table and the boxes need another", "add a table")
    for name in task.layout.stack:
        if name not in task.box_names:
            fail("layout.stack", f"there is no box '{name}'", f"use some of {', '.join(task.box_names)}")
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
    loose = len(task.boxes) - len(task.layout.fixed)
    if sum(max(1, lattice // 2) for lattice in lattices) < loose:
        fail(
            "layout.spacing",
            f"{loose} boxes do not fit {task.layout.spacing} m apart on the tables",
            "lower spacing or margin, or add tables",
        )


def _check_fixed(task: Task, fail: Fail) -> None:
    sizes = {box.name: box.size for box in task.boxes}
    fixed = task.layout.fixed
    if fixed and task.layout.kit == "random":
        fail("layout.kit", "the kit may be placed where a box is fixed", "name the kit's table")
    for i, place in enumerate(fixed):
        key = f"layout.fixed[{i}]"
        if place.object not in sizes:
            fail(f"{key}.object", f"there is no box '{place.object}'", f"use one of {', '.join(sizes)}")
        if place.object in task.layout.stack or place.object in [other.object for other in fixed[:i]]:
            fail(f"{key}.object", f"{place.object} has a place already", "give each box one place")
        if place.frame != task.robot_frame:
            fail(f"{key}.frame", f"'{place.frame}' is not the robot's frame", f"use {task.robot_frame}")
        for other in fixed[:i]:
            gap = (sizes[place.object] + sizes[other.object]) / 2 - _apart(place.position, other.position)
            if gap > 0.1 * sizes[place.object]:
                fail(f"{key}.position", f"{place.object} would be inside {other.object}", "move it to free space")
        x, y, z = (a + b for a, b in zip(place.position, task.robot_position, strict=True))
        under = [
            t
            for t in task.tables
            if abs(x - t.position[0]) <= t.size[0] / 2 and abs(y - t.position[1]) <= t.size[1] / 2
        ]
        if not any(z - sizes[place.object] / 2 > table.top - 0.1 * sizes[place.object] for table in under):
            fail(f"{key}.position", f"{place.object} would not be over a table", "move it over one")


def _apart(a: Vec3, b: Vec3) -> float:
    """Return the distance along the axis on which it is the largest."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _check_targets(task: Task, fail: Fail) -> None:
    rests_on: dict[str, str] = {}
    sizes = {box.name: box.size for box in task.boxes}
    for i, target in enumerate(task.targets):
        key = f"targets[{i}]"
        if target.object not in sizes:
            fail(f"{key}.object", f"there is no box '{target.object}'", f"use one of {', '.join(sizes)}")
        if target.frame not in task.frames:
            fail(f"{key}.frame", f"there is no frame '{target.frame}'", f"use one of {', '.join(task.frames)}")
        if target.object in rests_on:
            fail(f"{key}.object", f"{target.object} has a target already", "give each box one target")
        rests_on[target.object] = target.frame
        half = sizes[target.object] / 2
        if target.frame == task.kit.name and _hits_kit(task.kit, target.position, half):
            fail(
                f"{key}.position", f"{target.object} would be inside the kit's walls or plate", "move it to free space"
            )
        if target.frame in sizes and target.frame != target.object:
            gap = half + sizes[target.frame] / 2 - max(abs(x) for x in target.position)
            if gap > task.episode.tolerance:
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


def _hits_kit(kit: Kit, position: Vec3, half: float) -> bool:
    slack = 0.005
    x, y, z = (abs(position[0]), abs(position[1]), position[2])
    over_plate = max(x, y) < kit.size / 2 + half
    if over_plate and z - half < kit.thickness / 2 - slack:
        return True
    low = z - half < kit.thickness / 2 + kit.wall_height - slack
    inside = max(x, y) + half <= kit.inner
    outside = max(x, y) - half >= kit.size / 2
    return low and not inside and not outside


def _fail(source: str, key: str, problem: str, remedy: str) -> NoReturn:
    raise UserError(f"{source}, key {key}: {problem}; {remedy}")
