"""What a demonstration is: a sequence of picks and places, with the pose of the end effector in every frame of the scene.

Positions are metres in the named frame, quaternions are wxyz. `demonstration_folder` keeps them on the disk.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from bt_jax.behaviors.pose import Pose
from bt_jax.tasks import Task

__all__ = [
    "END_EFFECTOR_HEIGHT",
    "Action",
    "Demonstration",
    "Demonstrations",
    "Frames",
    "Instance",
    "Pose",
    "RecordedTask",
]

END_EFFECTOR_HEIGHT = 0.12  # of the end effector above the centre of what it holds, metres
Kind = Literal["pick", "place"]


@dataclasses.dataclass(frozen=True)
class RecordedTask:
    """In which task demonstrations were recorded: its name, the size of each of its boxes [m], and, where they are recorded,
    the task itself."""

    name: str
    boxes: Mapping[str, float]
    task: Task | None = dataclasses.field(default=None, compare=False)

    @staticmethod
    def of(task: Task) -> RecordedTask:
        """Return what is recorded of a task."""
        return RecordedTask(task.name, {box.name: box.edge for box in task.objects}, task)

    def difference(self, task: Task) -> str | None:
        """Return how the boxes of a task differ, as part of a sentence, or None."""
        for box in task.objects:
            known = self.boxes.get(box.name)
            if known is None:
                return f"task {task.name} has a {box.name} and {self.name} has none"
            if abs(known - box.edge) > 1e-6:
                return f"{box.name} measures {known:g} m in task {self.name} and {box.edge:g} m in {task.name}"
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
        """Return the frames of a task: the kit's, the boxes' and the robot's, which is the default."""
        names = (task.kit.name, *task.object_names, task.robot_frame)
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

    def nearest(self, frames: Sequence[str]) -> str:
        """Return which of the frames the handled object is nearest to."""
        return min(frames, key=lambda frame: float(np.linalg.norm(self.handled(frame))))


@dataclasses.dataclass(frozen=True)
class Demonstration:
    """What one person did once, from the first action to the last."""

    name: str
    actions: tuple[Action, ...]


@dataclasses.dataclass(frozen=True)
class Instance:
    """Which action of which demonstration, both counted from 0."""

    demonstration: int
    index: int


@dataclasses.dataclass(frozen=True)
class Demonstrations:
    """A set of demonstrations of one task. `problems` says, a sentence each, which ones were left out and why; `chosen` is
    the frame that a person has chosen for an action."""

    frames: Frames
    demonstrations: tuple[Demonstration, ...]
    problems: tuple[str, ...] = ()
    chosen: Mapping[Instance, str] = dataclasses.field(default_factory=dict)

    def __iter__(self) -> Iterator[Demonstration]:
        return iter(self.demonstrations)

    def __len__(self) -> int:
        return len(self.demonstrations)
