"""What is to be done: the objects of a scene, where they start, where they should end, and what an episode is worth.

All lengths are metres, all positions are in the named frame, all frames have the world's axes at the start of an episode.
"""

from __future__ import annotations

import dataclasses
from html import escape
from typing import Any, Literal

from bt_jax._util.errors import UserError

__all__ = [
    "Box",
    "Episode",
    "GeneSettings",
    "Kit",
    "Layout",
    "Subgoal",
    "Table",
    "Target",
    "Task",
    "Vec3",
    "Weights",
]

Vec3 = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Table:
    """A fixed block; boxes and the kit stand on its top. `position` is its centre in the world."""

    name: str
    position: Vec3
    size: Vec3

    @property
    def top(self) -> float:
        return self.position[2] + self.size[2] / 2


@dataclasses.dataclass(frozen=True)
class Kit:
    """An open box: a square plate with four walls standing on its edge. Its frame is at the plate's centre."""

    name: str = "KittingBox"
    size: float = 0.4
    thickness: float = 0.005
    wall_height: float = 0.04
    wall_thickness: float = 0.005

    @property
    def inner(self) -> float:
        """Half the width between opposite walls."""
        return self.size / 2 - self.wall_thickness


@dataclasses.dataclass(frozen=True)
class Box:
    """A cube that the robot can move. `size` is the edge, `color` is RGB in 0..1."""

    name: str
    size: float
    color: Vec3
    density: float = 1000.0

    @property
    def mass(self) -> float:
        """In kilograms."""
        return self.density * self.size**3


@dataclasses.dataclass(frozen=True)
class Target:
    """`object` should end with its centre at `position` in `frame`."""

    object: str
    position: Vec3
    frame: str

    def __str__(self) -> str:
        return f"{self.object} at ({', '.join(f'{x:g}' for x in self.position)}) in {self.frame}"


@dataclasses.dataclass(frozen=True)
class Layout:
    """How an episode starts. `kit` names a table or is "random"; `stack` lists boxes from the bottom up that start as
    one stack, `fixed` names boxes that always start at the same place in the robot's frame, and the others start at random
    places on the tables without the kit, centres at least `spacing` apart and `margin` away from the table's edge."""

    kit: str = "random"
    stack: tuple[str, ...] = ()
    spacing: float = 0.15
    margin: float = 0.125
    fixed: tuple[Target, ...] = ()


@dataclasses.dataclass(frozen=True)
class GeneSettings:
    """Where the `move` genes may place a box: beside and on every other box, and on a grid in the kit."""

    gap: float = 0.02
    grid: int = 3
    pitch: float = 0.133
    height: float = 0.055


@dataclasses.dataclass(frozen=True)
class Episode:
    """When an episode ends, and how far an object may be from where it should be."""

    max_ticks: int = 15
    success_ticks: int = 2
    action_ticks: int = 5
    tolerance: float = 0.03


@dataclasses.dataclass(frozen=True)
class Weights:
    """Costs in the fitness (paper, equation 1): per metre of distance, per node, and per bad ending."""

    distance: float = 1000.0
    node: float = 10.0
    timeout: float = 30.0
    failure: float = 50.0
    subgoal: float = 500.0


SubgoalReward = Literal["seen", "ticked"]


@dataclasses.dataclass(frozen=True)
class Subgoal:
    """A configuration worth reaching once, on the way: all `conditions` hold, written as in trees, for instance
    "clear(YellowBox)". `{box}` in a condition stands for every box."""

    name: str
    conditions: tuple[str, ...]


@dataclasses.dataclass(frozen=True, repr=False)
class Task:
    """Everything that defines a task; hashable, so that compiled functions can be kept per task.

    `subgoal_reward` says when a subgoal counts as reached, for the fitness and for `reached(subgoal)`: as soon as it holds
    ("seen"), or only once the tree has ticked `reached(subgoal)` while it holds ("ticked", as in the published runs).
    """

    name: str
    description: str
    tables: tuple[Table, ...]
    kit: Kit
    boxes: tuple[Box, ...]
    targets: tuple[Target, ...]
    layout: Layout = Layout()
    genes: GeneSettings = GeneSettings()
    episode: Episode = Episode()
    weights: Weights = Weights()
    subgoals: tuple[Subgoal, ...] = ()
    subgoal_reward: SubgoalReward = "ticked"
    robot_frame: str = "base_link"
    robot_position: Vec3 = (0.0, 1.0, 0.05)
    gripper_opening: float = 0.2

    @property
    def title(self) -> str:
        """Name and description on one line."""
        return f"{self.name}: {self.description}" if self.description else self.name

    @property
    def box_names(self) -> tuple[str, ...]:
        return tuple(box.name for box in self.boxes)

    def size(self, name: str) -> float:
        """Return the edge of a box, metres. Raise UserError if there is no such box."""
        for box in self.boxes:
            if box.name == name:
                return box.size
        raise UserError(f"there is no box '{name}'; choose one of {', '.join(self.box_names)}")

    @property
    def floor(self) -> float:
        """World z of the floor: 0, or the foot of the lowest table where tables reach below 0."""
        return min(0.0, *(table.position[2] - table.size[2] / 2 for table in self.tables))

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames in the order of their index: boxes, then the kit, then the robot."""
        return (*self.box_names, self.kit.name, self.robot_frame)

    @property
    def right(self) -> Vec3:
        """The world's horizontal axis that points to the right of a person who faces the robot across the tables."""
        x, y, _ = self.away
        return (y, 0.0 - x, 0.0)

    @property
    def away(self) -> Vec3:
        """The world's horizontal axis that points from that person to the robot, across the row of tables."""
        low, high = zip(*(self._extent(axis) for axis in (0, 1)), strict=True)
        across = 1 if high[0] - low[0] >= high[1] - low[1] else 0
        side = 1.0 if self.robot_position[across] >= (low[across] + high[across]) / 2 else -1.0
        return (0.0, side, 0.0) if across else (side, 0.0, 0.0)

    def _extent(self, axis: int) -> tuple[float, float]:
        """Return where the tables begin and end along an axis."""
        edges = [(table.position[axis], table.size[axis] / 2) for table in self.tables]
        return min(middle - half for middle, half in edges), max(middle + half for middle, half in edges)

    def _summary(self) -> list[tuple[str, str]]:
        """Return what a person wants to see of a task, as rows of a heading and a text."""
        return [
            ("boxes", ", ".join(f"{box.name} ({1000 * box.size:g} mm)" for box in self.boxes)),
            *(("target", str(target)) for target in self.targets),
            *(("subgoal", f"{subgoal.name}: {', '.join(subgoal.conditions)}") for subgoal in self.subgoals),
        ]

    def __repr__(self) -> str:
        return f"<Task {self.name}: {len(self.boxes)} boxes, {len(self.targets)} targets>"

    def __str__(self) -> str:
        return "\n".join([self.title, *(f"  {heading:8} {text}" for heading, text in self._summary())])

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = "".join(f"<tr><th>{heading}</th><td>{escape(text)}</td></tr>" for heading, text in self._summary())
        return f"<table><caption>{escape(self.title)}</caption>{rows}</table>"

    def to_dict(self) -> dict[str, Any]:
        """Return a plain mapping that `task_from_dict` reads back to an equal task."""
        return _plain(dataclasses.asdict(self))


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
