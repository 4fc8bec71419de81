"""What is to be done: the objects of a scene, where they start, where they should end, and what an episode is worth.

All lengths are metres, all positions are in the named frame, all frames have the world's axes at the start of an episode.
"""

from __future__ import annotations

import dataclasses
import functools
from html import escape
from typing import Any, Literal

from bt_jax._util.errors import UserError
from bt_jax.tasks.faults import Faults
from bt_jax.tasks.robot import STANDING, Robot
from bt_jax.tasks.things import Kit, Object, Table, Vec3

__all__ = [
    "Episode",
    "GeneSettings",
    "Layout",
    "Subgoal",
    "Target",
    "Task",
    "Weights",
]


LASTING_TICKS = 6  # of success, where things go wrong


@dataclasses.dataclass(frozen=True)
class Target:
    """`object` should end with its centre at `position` in `frame`, turned by `turn` degrees about the frame's vertical;
    any turn will do where none is given. The name of a part stands for any of its instances. `slot`: the slot that position
    and turn are those of, if any, as in "TrayA.a1"."""

    object: str
    position: Vec3
    frame: str
    turn: float | None = None
    slot: str = ""

    def __str__(self) -> str:
        if self.slot:
            return f"{self.object} in {self.slot}"
        turned = "" if self.turn is None else f", turned by {self.turn:g} degrees"
        return f"{self.object} at ({', '.join(f'{x:g}' for x in self.position)}) in {self.frame}{turned}"


@dataclasses.dataclass(frozen=True)
class Layout:
    """How an episode starts. `kit` names the table of the kits that do not name theirs, or is "random"; `stack` lists boxes
    from the bottom up that start as one stack, `fixed` names objects that always start at the same place in the robot's
    frame, and the others start at random places on the tables without a kit, centres at least `spacing` apart and `margin`
    away from the table's edge, turned by up to `turn` degrees to either side."""

    kit: str = "random"
    stack: tuple[str, ...] = ()
    spacing: float = 0.15
    margin: float = 0.125
    turn: float = 0.0
    fixed: tuple[Target, ...] = ()


@dataclasses.dataclass(frozen=True)
class GeneSettings:
    """Where the `move` genes may place an object: beside and on every other one, in the slots of every kit that take it, and
    on a grid in a kit without slots; an object that no slot takes, on the grid of every kit. `height` is that of the centre
    over the kit's frame on the grid; where none is given, objects stand on the plate."""

    gap: float = 0.02
    grid: int = 3
    pitch: float = 0.133
    height: float | None = None


@dataclasses.dataclass(frozen=True)
class Episode:
    """When an episode ends, how far [m] an object may be from where it should be, and by how much [degrees] it may be turned
    from how it should lie."""

    max_ticks: int = 15
    success_ticks: int = 2
    action_ticks: int = 5
    tolerance: float = 0.03
    turn_tolerance: float = 10.0

    def with_faults(self) -> Episode:
        """Return the rules of a task in which things go wrong: success has to last, so that what is undone late counts, and
        there are twice as many ticks, since what went wrong has to be done again."""
        return dataclasses.replace(
            self, max_ticks=2 * self.max_ticks, success_ticks=max(LASTING_TICKS, self.success_ticks)
        )

    def without_faults(self) -> Episode:
        """Return the rules of the task if nothing goes wrong any more: what `with_faults` takes, unless a success had to
        last for a number of ticks of its own before."""
        lasting = self.success_ticks if self.success_ticks > LASTING_TICKS else Episode.success_ticks
        return dataclasses.replace(self, max_ticks=max(1, self.max_ticks // 2), success_ticks=lasting)


@dataclasses.dataclass(frozen=True)
class Weights:
    """Costs in the fitness (paper, equation 1): per metre of distance, per node, and per bad ending; per radian of a wrong
    turn, and per metre that a base drives."""

    distance: float = 1000.0
    node: float = 10.0
    timeout: float = 30.0
    failure: float = 50.0
    subgoal: float = 500.0
    turn: float = 100.0
    travel: float = 0.0


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
    kits: tuple[Kit, ...]
    objects: tuple[Object, ...]
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
    finger_room: float = 0.0
    faults: Faults | None = None
    robot: Robot = STANDING

    @property
    def title(self) -> str:
        """Name and description on one line."""
        return f"{self.name}: {self.description}" if self.description else self.name

    @property
    def object_names(self) -> tuple[str, ...]:
        return tuple(thing.name for thing in self.objects)

    @functools.cached_property
    def instances(self) -> dict[str, tuple[str, ...]]:
        """The objects that a name in a leaf stands for: every object for itself, and a part for all its instances."""
        parts = dict.fromkeys(thing.part for thing in self.objects if thing.part)
        return {
            **{thing.name: (thing.name,) for thing in self.objects},
            **{part: tuple(thing.name for thing in self.objects if thing.part == part) for part in parts},
        }

    @functools.cached_property
    def all_cubes(self) -> bool:
        return all(thing.is_cube for thing in self.objects)

    @functools.cached_property
    def unturned_cubes(self) -> bool:
        """Whether all objects are cubes that start, and are to be put, parallel to the tables' edges, as in the published
        tasks."""
        turns = [place.turn or 0.0 for place in (*self.layout.fixed, *self.targets)]
        turns += [slot.turn for kit in self.kits for slot in kit.places]
        return self.all_cubes and not self.layout.turn and all(turn % 90 == 0 for turn in turns)

    @property
    def draws_by_size(self) -> bool:
        """Whether objects start as far from each other and from the tables' edges as their sizes take. Cubes around one kit
        that do not start turned, as in the published tasks, only keep `layout.spacing` and `layout.margin`."""
        turned = self.layout.turn or any(place.turn for place in self.layout.fixed)
        return bool(turned) or not self.all_cubes or len(self.kits) > 1

    def widest_with(self, name: str) -> Object:
        """Return the object that reaches the farthest, seen from above, of those that start in one stack with an object, or
        that object itself."""
        together = self.layout.stack if name in self.layout.stack else (name,)
        return max(map(self.thing, together), key=lambda thing: thing.reach)

    @property
    def kinds(self) -> tuple[str, ...]:
        """What there is to move, interchangeable instances once: the objects of no part, and the parts, as listed."""
        return tuple(dict.fromkeys(thing.part or thing.name for thing in self.objects))

    def thing(self, name: str) -> Object:
        """Return an object, or for a part its first instance. Raise UserError if there is no such object or part."""
        found = self.instances.get(name)
        if found is None:
            raise UserError(f"there is no object '{name}'; choose one of {', '.join(self.kinds)}")
        return self.objects[self.object_names.index(found[0])]

    @property
    def kit_names(self) -> tuple[str, ...]:
        return tuple(kit.name for kit in self.kits)

    @property
    def floor(self) -> float:
        """World z of the floor: 0, or the foot of the lowest table where tables reach below 0."""
        return min(0.0, *(table.position[2] - table.size[2] / 2 for table in self.tables))

    @property
    def frames(self) -> tuple[str, ...]:
        """Frames in the order of their index: objects, then kits, then the robot."""
        return (*self.object_names, *self.kit_names, self.robot_frame)

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

    def _counted(self) -> list[str]:
        """Return what there is to move, with its measures, and how many of each part."""
        counts = {name: len(self.instances[name]) for name in self.kinds}
        shown = {name: f"{counts[name]} {name}" if self.thing(name).part else name for name in self.kinds}
        return [f"{shown[name]} ({self.thing(name).measures})" for name in self.kinds]

    def _summary(self) -> list[tuple[str, str]]:
        """Return what a person wants to see of a task, as rows of a heading and a text."""
        return [
            ("objects", ", ".join(self._counted())),
            *(("target", str(target)) for target in self.targets),
            *(("subgoal", f"{subgoal.name}: {', '.join(subgoal.conditions)}") for subgoal in self.subgoals),
        ]

    def __repr__(self) -> str:
        return f"<Task {self.name}: {len(self.objects)} objects, {len(self.targets)} targets>"

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
