"""Whether a robot that drives can do its task: it stands clear of the tables, finds its ways, and reaches what it has to."""

from __future__ import annotations

import dataclasses
import math

from bt_jax.tasks.refusals import Fail
from bt_jax.tasks.roadmap import roadmap
from bt_jax.tasks.stations import in_reach, is_free, standing_places, start_of, wanted
from bt_jax.tasks.task import Task

__all__ = ["check_base", "with_drives"]

MOST_STATIONS = 64


def check_base(task: Task, fail: Fail) -> None:
    """Fail for a base that touches a table where it stands, or from which the arm does not reach what it has to."""
    base = task.robot.base
    if base is None:
        return
    if len(base.stations) > MOST_STATIONS:
        fail("robot.base.stations", f"{len(base.stations)} stations are too many", f"use {MOST_STATIONS} or fewer")
    standing = [("robot_position", start_of(task))]
    standing += [(f"robot.base.stations[{i}]", station) for i, station in enumerate(base.stations)]
    for key, place in standing:
        for table in task.tables:
            if not is_free([table], place, base.radius):
                problem = f"the base, {base.radius:g} m in radius, would be inside {table.name}"
                fail(key, problem, "move it away from the table")
    stations = standing_places(task)
    if not stations:
        least = max(one.point[2] for one in wanted(task)) - task.robot_position[2]
        problem = f"an arm that reaches {base.reach:g} m reaches nothing from beside the tables"
        fail(
            "robot.base.reach",
            problem,
            f"write more, or a robot_position nearer to {task.robot_position[2] + least:g} m",
        )
    for i, distance in enumerate(roadmap(task).distances[0]):
        if math.isinf(distance):
            x, y = stations[i]
            key = f"robot.base.stations[{i}]" if base.stations else "tables"
            fail(key, f"no way leads from the start to ({x:g}, {y:g})", "leave more room between the tables")
    for one in wanted(task):
        if any(in_reach(task, station, one.point) for station in stations):
            continue
        x, y, z = one.point
        where = f"the place of {one.name}" if one.key else f"({x:g}, {y:g}) on {one.name}, where objects may start"
        remedy = "add a station near it, or raise robot.base.reach" if base.stations else "raise robot.base.reach"
        fail(one.key or "robot.base.stations", f"no station reaches {where}, {z:.3g} m high", remedy)


def with_drives(task: Task, *, ticks_given: bool) -> Task:
    """Return a task whose actions have time for the longest drive, and whose episodes, unless their ticks are given, for one
    to each object and one to its place."""
    if task.robot.base is None:
        return task
    longest, episode = roadmap(task).longest, task.episode
    drives = 2 * len(task.targets) * (1 if task.faults is None else 2)
    more = 0 if ticks_given else drives * longest
    ticks = {"action_ticks": max(episode.action_ticks, longest), "max_ticks": episode.max_ticks + more}
    return dataclasses.replace(task, episode=dataclasses.replace(episode, **ticks))
