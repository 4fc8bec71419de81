"""What is to be done: the objects of a scene, where they start, where they should end, and what an episode is worth.

A task is one YAML file. It may name another task in `extends` and only say what differs. All lengths are metres, all
positions are in the named frame, all frames have the world's axes at the start of an episode.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, NoReturn

import yaml

from bt_jax.errors import UserError

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
    "Weights",
    "load_task",
    "task_names",
]

TASKS = Path(__file__).parent / "tasks"
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


@dataclasses.dataclass(frozen=True)
class Target:
    """`object` should end with its centre at `position` in `frame`."""

    object: str
    position: Vec3
    frame: str


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


@dataclasses.dataclass(frozen=True)
class Subgoal:
    """A configuration worth reaching once, on the way: all `conditions` hold, written as in trees, for instance
    "clear(YellowBox)". `{box}` in a condition stands for every box."""

    name: str
    conditions: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Task:
    """Everything that defines a task; hashable, so that compiled functions can be kept per task."""

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
    robot_frame: str = "base_link"
    robot_position: Vec3 = (0.0, 1.0, 0.05)
    gripper_opening: float = 0.2

    @property
    def box_names(self) -> tuple[str, ...]:
        return tuple(box.name for box in self.boxes)

    def size(self, name: str) -> float:
        """Edge of a box, metres. Raises UserError where there is no such box."""
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
        """Where the tables begin and end along an axis."""
        edges = [(table.position[axis], table.size[axis] / 2) for table in self.tables]
        return min(middle - half for middle, half in edges), max(middle + half for middle, half in edges)

    def with_targets(self, targets: Sequence[Target], *, source: str) -> Task:
        """This task with more targets, each in place of one that the same object has; `source` is named in errors."""
        kept = {target.object: target for target in (*self.targets, *targets)}
        task = dataclasses.replace(self, targets=tuple(kept.values()))
        _check(task, source)
        return task

    def with_subgoal(self, subgoal: Subgoal, *, source: str) -> Task:
        """This task with one more subgoal, unless it has that already; `source` is named in errors."""
        if subgoal in self.subgoals:
            return self
        if subgoal.name in [other.name for other in self.subgoals]:
            raise UserError(f"{source}: task {self.name} has another subgoal '{subgoal.name}'; rename the new one")
        task = dataclasses.replace(self, subgoals=(*self.subgoals, subgoal))
        _check(task, source)
        return task

    def to_dict(self) -> dict[str, Any]:
        """A plain mapping that `task_from_dict` reads back to an equal task."""
        return _plain(dataclasses.asdict(self))


RESERVED = ("floor", "gripper", "kit", "metal", "nothing", "plate", "rubber", "sky", "table", "wall_back", "wall_front",
            "wall_left", "wall_right")  # fmt: skip
SUBGOALS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"unstacked": ("holding(nothing)", "reachable({box})", "clear({box})")}  # every box rests on a table or in the kit
)


def task_names() -> list[str]:
    """Names of the tasks that come with the package."""
    return sorted(path.stem for path in TASKS.glob("*.yaml"))


def load_task(name_or_path: str | Path) -> Task:
    """Reads a task by name (one of `task_names()`) or from a YAML file.

    Raises UserError, naming file, key and remedy, where the task cannot be meant.
    """
    path = _find(name_or_path)
    return task_from_dict(_read(path), source=str(path))


def task_from_dict(data: Mapping[str, Any], *, source: str) -> Task:
    """Builds a task from a mapping as in the YAML files and checks that it makes sense; `source` is named in errors."""
    data = dict(data)
    data.pop("extends", None)
    if isinstance(data.get("subgoals"), list | tuple):
        data["subgoals"] = [_subgoal(entry, source) for entry in data["subgoals"]]
    task = _build(Task, data, source, "")
    _check(task, source)
    return task


def _subgoal(entry: Any, source: str) -> Any:
    """A subgoal that is only named is one of those that every task knows."""
    if not isinstance(entry, str):
        return entry
    if entry not in SUBGOALS:
        known = ", ".join(SUBGOALS)
        raise UserError(
            f"{source}, key subgoals: '{entry}' is unknown; use one of {known}, or give a name with conditions"
        )
    return {"name": entry, "conditions": list(SUBGOALS[entry])}


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if text in task_names():
        return TASKS / f"{text}.yaml"
    path = Path(text)
    if path.suffix in (".yaml", ".yml"):
        if path.is_file():
            return path
        raise UserError(f"there is no task file {path}; check the path, or name one of: {', '.join(task_names())}")
    raise UserError(f"unknown task '{text}'; choose one of {', '.join(task_names())}, or give a .yaml file with --task")


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path} cannot be read ({error}); check its name and permissions") from error
    except yaml.YAMLError as error:
        where = getattr(error, "problem_mark", None)
        line = f", line {where.line + 1}" if where else ""
        raise UserError(
            f"{path}{line} is not valid YAML ({getattr(error, 'problem', error)}); mend that line"
        ) from error
    if not isinstance(data, dict):
        raise UserError(f"{path} must be a mapping with keys such as boxes and targets; see bt_jax/tasks/stack.yaml")
    if "extends" not in data:
        return data
    path = path.resolve()
    base = _find(data["extends"]) if str(data["extends"]) in task_names() else path.parent / str(data["extends"])
    base = base.resolve()
    if not base.is_file() or base in (*seen, path):
        raise UserError(
            f"{path}, key extends: '{data['extends']}' is not another task; name one of {', '.join(task_names())}"
        )
    return _merge(_read(base, (*seen, path)), data)


def _merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        both_maps = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merge(base[key], value) if both_maps else value
    return merged


_NESTED = {cls.__name__: cls for cls in (Table, Kit, Box, Target, Layout, GeneSettings, Episode, Weights, Subgoal)}


def _build(cls: type, data: Any, source: str, where: str) -> Any:
    if not isinstance(data, Mapping):
        raise UserError(f"{source}, key {where}: expected a mapping, found {data!r}; see bt_jax/tasks/stack.yaml")
    fields = {field.name: field for field in dataclasses.fields(cls)}
    for key in data:
        if key not in fields:
            raise UserError(f"{source}, key {where}{key}: not known here; use one of {', '.join(fields)}")
    for field in fields.values():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and field.name not in data:
            raise UserError(f"{source}, key {where}{field.name}: missing; add it")
    return cls(**{key: _value(fields[key], value, source, f"{where}{key}") for key, value in data.items()})


def _value(field: dataclasses.Field, value: Any, source: str, where: str) -> Any:
    kind = str(field.type)
    if kind in _NESTED:
        return _build(_NESTED[kind], value, source, f"{where}.")
    item = _NESTED.get(kind.removeprefix("tuple[").removesuffix(", ...]"))
    if item is None:
        return _scalar(kind, value, source, where)
    if not isinstance(value, list):
        raise UserError(f"{source}, key {where}: expected a list, found {value!r}; write one '- ' entry for each")
    return tuple(_build(item, entry, source, f"{where}[{i}].") for i, entry in enumerate(value))


def _scalar(kind: str, value: Any, source: str, where: str) -> Any:
    if kind == "float":
        return _number(value, source, where)
    if kind == "int":
        if not _number(value, source, where).is_integer():
            raise UserError(f"{source}, key {where}: expected a whole number, found {value!r}; mend it")
        return int(value)
    if kind == "Vec3":
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise UserError(f"{source}, key {where}: expected three numbers [x, y, z], found {value!r}; mend it")
        return tuple(_number(x, source, where) for x in value)
    if kind.startswith("tuple"):
        if not isinstance(value, list | tuple) or not all(isinstance(x, str) for x in value):
            raise UserError(f"{source}, key {where}: expected a list of names, found {value!r}; mend it")
        return tuple(value)
    if not isinstance(value, str):
        raise UserError(f"{source}, key {where}: expected a name, found {value!r}; mend it")
    return value


def _number(value: Any, source: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UserError(f"{source}, key {where}: expected a number, found {value!r}; mend it")
    return float(value)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def _fail(source: str, key: str, problem: str, remedy: str) -> NoReturn:
    raise UserError(f"{source}, key {key}: {problem}; {remedy}")


def _check(task: Task, source: str) -> None:
    fail = functools.partial(_fail, source)
    names = [*task.frames, *(table.name for table in task.tables)]
    if not re.fullmatch(r"[\w-]+", task.name):
        fail("name", f"'{task.name}' is not a name", "use letters, digits, underscores and dashes")
    for name in names:
        if name in RESERVED:
            fail("boxes", f"the name '{name}' is taken by the scene itself", "choose another")
        if not name.isidentifier():
            fail("boxes", f"'{name}' is not a name", "use letters, digits and underscores")
        if names.count(name) > 1:
            fail("boxes", f"the name '{name}' stands for two things", "rename one of them")
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
            fail(f"subgoals[{i}].name", f"'{subgoal.name}' stands twice", "rename one of them")
        if not subgoal.conditions:
            fail(f"subgoals[{i}].conditions", "there are none", "add a condition, for instance clear(YellowBox)")
    _check_sizes(task, fail)
    _check_layout(task, fail)
    _check_targets(task, fail)


def _check_sizes(task: Task, fail: Any) -> None:
    for i, box in enumerate(task.boxes):
        if box.size <= 0 or box.density <= 0:
            fail(f"boxes[{i}]", f"{box.name} has no size or weight", "make size and density positive")
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
    for i, table in enumerate(task.tables):
        if min(table.size) <= 0:
            fail(f"tables[{i}].size", "must be positive", "mend it")
        if task.kit.size > min(table.size[:2]):
            fail(
                "kit.size", f"{task.kit.size} m is wider than {table.name}", "make the kit smaller or the table larger"
            )
    for section in ("kit", "genes", "episode", "weights", "layout"):
        for key, value in dataclasses.asdict(getattr(task, section)).items():
            if isinstance(value, float | int) and value < 0:
                fail(f"{section}.{key}", f"{value} is negative", "make it zero or more")
    for key in ("size", "thickness", "wall_height", "wall_thickness"):
        if getattr(task.kit, key) <= 0:
            fail(f"kit.{key}", "must be more than zero", "mend it")
    if task.kit.inner <= 0:
        fail("kit.wall_thickness", "the walls leave no room", "make the walls thinner or the kit larger")
    if task.episode.max_ticks < 1 or task.episode.success_ticks < 1 or task.episode.action_ticks < 1:
        fail("episode", "the numbers of ticks must be at least 1", "raise them")


def _check_layout(task: Task, fail: Any) -> None:
    tables = [table.name for table in task.tables]
    if task.layout.kit != "random" and task.layout.kit not in tables:
        fail("layout.kit", f"there is no table '{task.layout.kit}'", f"use random or one of {', '.join(tables)}")
    if len(task.tables) < 2:
        fail("tables", "the kit takes one table and the boxes need another", "add a table")
    for name in task.layout.stack:
        if name not in task.box_names:
            fail("layout.stack", f"there is no box '{name}'", f"use some of {', '.join(task.box_names)}")
    if len(set(task.layout.stack)) < len(task.layout.stack):
        fail("layout.stack", "a box stands in it twice", "name each box once")
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


def _check_fixed(task: Task, fail: Any) -> None:
    sizes = {box.name: box.size for box in task.boxes}
    fixed = task.layout.fixed
    if fixed and task.layout.kit == "random":
        fail("layout.kit", "the kit may come to stand where a box is fixed", "name the kit's table")
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
            fail(f"{key}.position", f"{place.object} would be on no table", "move it over one")


def _apart(a: Vec3, b: Vec3) -> float:
    """Distance along the axis on which it is the largest."""
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def _check_targets(task: Task, fail: Any) -> None:
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
