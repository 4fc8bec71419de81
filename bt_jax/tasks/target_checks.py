"""Whether the targets of a task go together: with its objects, its frames, its kits, one another, and its ticks."""

from __future__ import annotations

import itertools

from bt_jax.tasks.footprints import Footprint, overlap
from bt_jax.tasks.refusals import Fail
from bt_jax.tasks.slots import fits, slots_by_name
from bt_jax.tasks.start_checks import block_overlap
from bt_jax.tasks.support import kit_origin, resolve_turned, start_turn
from bt_jax.tasks.task import Target, Task
from bt_jax.tasks.things import Kit, Object, Vec3

__all__ = ["TARGET_RULES", "check_target_names"]

TICKS_PER_MOVE = 2  # one to pick and one to place


def check_target_names(task: Task, fail: Fail) -> None:
    """Fail for targets that name what the task does not have, or one another in a circle."""
    for i, target in enumerate(task.targets):
        _check_names(task, i, target, fail)
    _check_circles(task, fail)


def _check_names(task: Task, i: int, target: Target, fail: Fail) -> None:
    key, name = f"targets[{i}]", target.object
    if name not in task.instances:
        fail(f"{key}.object", f"there is no object '{name}'", f"use one of {', '.join(task.kinds)}")
    if target.frame in task.instances and target.frame not in task.object_names:
        remedy = f"use one of {', '.join(task.instances[target.frame])}"
        fail(f"{key}.frame", f"'{target.frame}' is a part, and a frame is one object", remedy)
    if target.frame not in task.frames:
        fail(f"{key}.frame", f"there is no frame '{target.frame}'", f"use one of {', '.join(task.frames)}")
    earlier, thing = [other.object for other in task.targets[:i]], task.thing(name)
    if name in earlier and name in task.object_names:
        fail(f"{key}.object", f"{name} has a target already", "give each object one target")
    if thing.part:
        most = len(task.instances[thing.part])
        if sum(task.thing(other).part == thing.part for other in earlier) >= most:
            there = f"there {'is' if most == 1 else 'are'} only {most} of {thing.part}"
            fail(f"{key}.object", there, "raise its count or drop a target")
    if target.turn is not None and not task.thing(name).symmetry:
        fail(f"{key}.turn", f"{name} is a cylinder, which looks alike in every turn", "leave turn out")
    slots = slots_by_name(task.kits)
    if target.slot and target.slot not in slots:
        fail(f"{key}.slot", f"there is no slot '{target.slot}'", f"use one of {', '.join(slots)}")


def _check_slots(task: Task, fail: Fail) -> None:
    for i, target in enumerate(task.targets):
        if target.slot:
            _check_slot(task, i, target, fail)


def _check_slot(task: Task, i: int, target: Target, fail: Fail) -> None:
    kit, slot = slots_by_name(task.kits)[target.slot]
    thing = task.thing(target.object)
    if slot.takes not in ("", thing.name, thing.part):
        fail(f"targets[{i}].slot", f"{target.slot} is for {slot.takes}, not for {target.object}", "use another slot")
    if not fits(kit, slot, thing):
        x, y = kit.room(slot)
        room = f"{2000 * x:.4g} x {2000 * y:.4g} mm between the walls"
        problem = f"{target.object} ({thing.measures}) does not fit in {target.slot}, {room}"
        fail(f"targets[{i}].slot", problem, f"use another slot, turn this one, or make {kit.name} larger")


def _check_places(task: Task, fail: Fail) -> None:
    for i, target in enumerate(task.targets):
        _check_place(task, i, target, fail)


def _check_place(task: Task, i: int, target: Target, fail: Fail) -> None:
    key, half = f"targets[{i}].position", task.thing(target.object).half_at(target.turn)
    for kit in task.kits:
        if target.frame == kit.name and _hits_kit(kit, target.position, half):
            fail(key, f"{target.object} would be inside the kit's walls or plate", "move it to free space")
    if target.frame in task.object_names and target.frame != target.object:
        below = task.thing(target.frame).half_at(None)
        if block_overlap(half, target.position, below, (0.0, 0.0, 0.0)) > task.episode.tolerance:
            fail(key, f"{target.object} would be inside {target.frame}", "move it to free space")


def _check_all_in_reach(task: Task, fail: Fail) -> None:
    for i, target in enumerate(task.targets):
        _check_reach(task, i, target, fail)


def _check_reach(task: Task, i: int, target: Target, fail: Fail) -> None:
    """Fail for a target below the tables, where the gripper does not reach."""
    root, position, _ = resolve_turned(task, target)
    if root in task.object_names:
        return
    on_robot = root == task.robot_frame
    origins = [task.robot_position] if on_robot else [kit_origin(task, table, root) for table in task.tables]
    if max(z for _, _, z in origins) + position[2] < min(table.top for table in task.tables):
        problem = f"{target.object} would be below the tables, out of the gripper's reach"
        fail(f"targets[{i}].position", problem, "move it onto a table or into a kit")


def _hits_kit(kit: Kit, position: Vec3, half: Vec3) -> bool:
    slack = 0.005
    x, y, bottom = abs(position[0]), abs(position[1]), position[2] - half[2]
    over_plate = x < kit.half[0] + half[0] and y < kit.half[1] + half[1]
    if over_plate and bottom < kit.plate - slack:
        return True
    low = bottom < kit.rim - slack
    inside = x + half[0] <= kit.inner[0] and y + half[1] <= kit.inner[1]
    outside = x - half[0] >= kit.half[0] or y - half[1] >= kit.half[1]
    return low and not outside and (not inside or _hits_divider(kit, position, half))


def _hits_divider(kit: Kit, position: Vec3, half: Vec3) -> bool:
    return any(
        all(abs(a - b) < c + d - 1e-6 for a, b, c, d in zip(position, middle, half, across, strict=False))
        for middle, across in list(kit.walls())[4:]
    )


def _check_circles(task: Task, fail: Fail) -> None:
    """Fail where objects stand in one another's frames."""
    frames = {target.object: target.frame for target in task.targets}
    for start in frames:
        seen, frame = [start], frames[start]
        while frame in frames or frame == start:
            if frame in seen:
                chain = " in the frame of ".join([*seen, frame])
                fail("targets", f"circular: {chain}", "give one of them a position in the kit or the robot's frame")
            seen.append(frame)
            frame = frames[frame]


def _check_apart(task: Task, fail: Fail) -> None:
    for (i, one), (j, other) in itertools.combinations(enumerate(task.targets), 2):
        if _overlap(task, one, other):
            fail(f"targets[{j}]", f"{other.object} would be inside {one.object} of targets[{i}]", "move one of them")


def _overlap(task: Task, one: Target, other: Target) -> bool:
    """Return whether two targets are at one place, so that both cannot be met."""
    (frame, here, turn), (other_frame, there, other_turn) = (resolve_turned(task, it) for it in (one, other))
    things = task.thing(one.object), task.thing(other.object)
    slack = min(task.episode.tolerance, *(edge / 4 for thing in things for edge in thing.size))
    if frame != other_frame or (things[0].height + things[1].height) / 2 - abs(here[2] - there[2]) <= slack:
        return False
    footprints = (
        _footprint(task, things[0], here, one, turn),
        _footprint(task, things[1], there, other, other_turn),
    )
    return overlap(*footprints) > slack


def _footprint(task: Task, thing: Object, at: Vec3, target: Target, turn: float) -> Footprint:
    known = target.turn is not None or start_turn(task, target.object) is not None
    return Footprint.of(thing, (at[0], at[1]), turn if known else None)


def _check_ticks(task: Task, fail: Fail) -> None:
    """Fail if the ticks are too few to move every object that cannot be at its target from the start."""
    placed = {*task.layout.stack, *(place.object for place in task.layout.fixed)}
    instances = {target.object: task.instances[target.object] for target in task.targets}
    moves = 0
    for name, objects in instances.items():
        wanted = sum(target.object == name for target in task.targets)
        moves += max(0, wanted - sum(one in placed for one in objects))
    least = TICKS_PER_MOVE * moves + task.episode.success_ticks
    if task.episode.max_ticks < least:
        problem = f"{task.episode.max_ticks} ticks are too few to move {moves} object{'s' if moves > 1 else ''}"
        fail("episode.max_ticks", problem, f"write {least} or more")


TARGET_RULES = (_check_slots, _check_places, _check_all_in_reach, _check_apart, _check_ticks)
