"""What a demonstration is: a sequence of picks and places, with the pose of the end effector in every frame of the scene.

Positions are metres in the named frame, quaternions are wxyz. `demonstration_folder` keeps them on the disk.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from bt_jax.behaviors.geometry import heading
from bt_jax.behaviors.pose import Pose
from bt_jax.lfd.corrections import Corrections, Instance
from bt_jax.tasks import Object, Task

__all__ = [
    "END_EFFECTOR_HEIGHT",
    "Action",
    "Corrections",
    "Demonstration",
    "Demonstrations",
    "Frames",
    "Instance",
    "Pose",
    "RecordedTask",
    "Size",
]

END_EFFECTOR_HEIGHT = 0.12  # of the end effector above the centre of what it holds, metres
SAME_SIZE = 1e-6  # metres
Kind = Literal["pick", "place"]
Size = float | tuple[float, ...]  # of a cube its edge, of a cylinder radius and height, of others three edges, metres


@dataclasses.dataclass(frozen=True)
class RecordedTask:
    """In which task demonstrations were recorded: its name, the size of each of its objects, and, where they are recorded,
    the task itself."""

    name: str
    boxes: Mapping[str, Size]
    task: Task | None = dataclasses.field(default=None, compare=False)

    @staticmethod
    def of(task: Task) -> RecordedTask:
        """Return what is recorded of a task."""
        return RecordedTask(task.name, {thing.name: _size(thing) for thing in task.objects}, task)

    def difference(self, task: Task) -> str | None:
        """Return how the objects of a task differ, as part of a sentence, or None."""
        for thing in task.objects:
            known = self.boxes.get(thing.name)
            if known is None:
                return f"task {task.name} has a {thing.name} and {self.name} has none"
            there, here = np.atleast_1d(known), np.atleast_1d(_size(thing))
            if there.shape != here.shape or np.abs(there - here).max() > SAME_SIZE:
                measures = [_measured(size) for size in (known, _size(thing))]
                return f"{thing.name} measures {measures[0]} in task {self.name} and {measures[1]} in {task.name}"
        return None


@dataclasses.dataclass(frozen=True)
class Frames:
    """The frames in which poses are recorded: the fixtures' and objects', and the robot's; `default` serves where the
    demonstrations do not tell the frame. `recorded` is None if the task was not recorded."""

    names: tuple[str, ...]
    default: str
    robot: str
    recorded: RecordedTask | None = dataclasses.field(default=None, compare=False)

    @staticmethod
    def of(task: Task) -> Frames:
        """Return the frames of a task: the kits', the objects' and the robot's, which is the default."""
        names = (*task.kit_names, *task.object_names, task.robot_frame)
        return Frames(names, task.robot_frame, task.robot_frame, RecordedTask.of(task))

    @property
    def objects(self) -> tuple[str, ...]:
        """All frames but the robot's."""
        return tuple(name for name in self.names if name != self.robot)


@dataclasses.dataclass(frozen=True)
class Action:
    """A pick or a place, with the pose of the end effector in every frame at that moment. `sigmas` are the standard
    deviations of its positions [m] where they were measured; without an entry nothing is known of it."""

    kind: Kind
    poses: Mapping[str, Pose]
    sigmas: Mapping[str, float] = dataclasses.field(default_factory=dict)

    def handled(self, frame: str) -> Float[np.ndarray, "3"]:
        """Return where the centre of the handled object is, in a frame [m]: below the end effector."""
        return self.poses[frame].apply((0.0, 0.0, -END_EFFECTOR_HEIGHT))

    def origin(self, frame: str, within: str) -> Float[np.ndarray, "3"]:
        """Return where the origin of a frame is in another one [m]."""
        return self.poses[within].apply(self.poses[frame].inverse().position)

    def pose(self, frame: str, within: str) -> Pose:
        """Return the pose of a frame in another one."""
        return self.poses[within].compose(self.poses[frame].inverse())

    def turn(self, frame: str, within: str) -> float:
        """Return how far a frame is turned about the vertical of another one, degrees in (-180, 180]."""
        return math.degrees(heading(self.pose(frame, within)))

    def nearest(self, frames: Sequence[str]) -> str:
        """Return which of the frames the handled object is nearest to."""
        return min(frames, key=lambda frame: float(np.linalg.norm(self.handled(frame))))


@dataclasses.dataclass(frozen=True)
class Demonstration:
    """What one person did once, from the first action to the last."""

    name: str
    actions: tuple[Action, ...]

    def things(self, frames: Frames) -> tuple[str, ...]:
        """Return the object that each action handles: of a pick the nearest, of a place what was picked before."""
        found: list[str] = []
        for action in self.actions:
            found.append(action.nearest(frames.objects) if action.kind == "pick" or not found else found[-1])
        return tuple(found)


@dataclasses.dataclass(frozen=True)
class Demonstrations:
    """A set of demonstrations of one task. `problems` says, a sentence each, which ones were left out and why; `corrections`
    is what a person has said about them."""

    frames: Frames
    demonstrations: tuple[Demonstration, ...]
    problems: tuple[str, ...] = ()
    corrections: Corrections = dataclasses.field(default_factory=Corrections)

    def __iter__(self) -> Iterator[Demonstration]:
        return iter(self.demonstrations)

    def __len__(self) -> int:
        return len(self.demonstrations)


def _size(thing: Object) -> Size:
    """Return what is recorded of the size of an object."""
    if thing.shape == "cylinder":
        return thing.size[0] / 2, thing.height
    return thing.edge if thing.is_cube else thing.size


def _measured(size: Size) -> str:
    match size:
        case (radius, height):
            return f"{radius:g} m in radius and {height:g} m in height"
        case (x, y, z):
            return f"{x:g} x {y:g} x {z:g} m"
    return f"{size:g} m"
