"""Demonstrations made by computer with objects of any shape: turned cuboids, interchangeable parts and slots.

As in `synthetic`, the demonstrator carries everything straight to its place, and nothing falls. Of a part it takes whichever
instance it likes. What no placement turns stays turned as it lay.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from bt_jax.behaviors.geometry import heading
from bt_jax.behaviors.pose import Pose
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT, Action, Demonstration, Frames, Kind
from bt_jax.lfd.evaluation.random_kits import random_kit_task
from bt_jax.mjx_env.scene.placement import draw_kit_table, draw_poses
from bt_jax.tasks import Target, Task
from bt_jax.tasks.support import kit_origin

__all__ = ["demonstrate_kit", "random_kit"]


def random_kit(task: Task, *, objects: int, rng: np.random.Generator) -> Task:
    """Return a task with this many objects, which all start at random places and in random turns; each of its targets comes
    after that of its frame."""
    made = random_kit_task(task, objects=objects, rng=rng)
    left, ordered = list(made.targets), []
    while left:
        frames = {target.object for target in left}
        ready = next(target for target in left if target.frame not in frames)
        ordered.append(ready)
        left.remove(ready)
    layout = dataclasses.replace(made.layout, fixed=(), stack=(), turn=180.0)
    return dataclasses.replace(made, layout=layout, targets=tuple(ordered))


def demonstrate_kit(
    task: Task,
    placements: Sequence[Target],
    *,
    rng: np.random.Generator,
    noise: float = 0.0,
    turn_noise: float = 0.0,
    name: str = "demo1",
) -> Demonstration:
    """Move objects, one after the other, from a random layout of the task to their places, and return the recording.

    `noise` is the standard deviation of a release along each axis [m], `turn_noise` that of a turn that is meant [degrees].
    Layout and noise are drawn from `rng` in a way that the same generator without noise shows the same layout and instances.
    Raise UserError if there is no room for the objects.
    """
    poses, frames, actions = _random_layout(task, rng), Frames.of(task).names, []
    left = {target.object: list(task.instances[target.object]) for target in placements}
    for placement in placements:
        own = left[placement.object]
        taken = own.pop(rng.integers(len(own)))
        actions.append(_record("pick", poses[taken], poses, frames))
        frame = poses[placement.frame]
        off, turn_off = noise * rng.standard_normal(3), turn_noise * rng.standard_normal()
        goal = frame.apply(placement.position)
        angle = heading(poses[taken])
        if placement.turn is not None:
            angle = heading(frame) + math.radians(placement.turn + turn_off)
        released = _standing(goal + off, angle)
        actions.append(_record("place", released, {**poses, taken: released}, frames))
        poses = {**poses, taken: _standing((*released.position[:2], goal[2]), angle)}
    return Demonstration(name, tuple(actions))


def _random_layout(task: Task, rng: np.random.Generator) -> dict[str, Pose]:
    """Return where every frame is in the world."""
    table = task.tables[draw_kit_table(task, rng)]
    kits = {name: Pose(kit_origin(task, table, name)) for name in task.kit_names}
    objects = zip(task.object_names, map(Pose.of, draw_poses(task, rng, table).tolist()), strict=True)
    return {**dict(objects), **kits, task.robot_frame: Pose(task.robot_position)}


def _standing(point: Sequence[float] | np.ndarray, angle: float) -> Pose:
    """Return an upright pose that is turned by an angle, radians."""
    x, y, z = map(float, point)
    return Pose((x, y, z), (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)))


def _record(kind: Kind, handled: Pose, poses: Mapping[str, Pose], frames: Sequence[str]) -> Action:
    effector = handled.compose(Pose((0.0, 0.0, END_EFFECTOR_HEIGHT)))
    return Action(kind, {frame: poses[frame].inverse().compose(effector) for frame in frames})
