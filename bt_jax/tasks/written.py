"""Tasks as people write them: short forms of sizes, parts, slots and targets, and the names that older files use."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any, TypeVar

from bt_jax._util.errors import UserError
from bt_jax.tasks.faults import Faults, faults_of
from bt_jax.tasks.robot import STANDING, Robot
from bt_jax.tasks.slots import slot_position, slot_turn, slots_by_name
from bt_jax.tasks.task import Episode, GeneSettings, Layout, Subgoal, SubgoalReward, Target, Task, Weights
from bt_jax.tasks.things import Kit, Object, Shape, Slot, Table, Vec2, Vec3

__all__ = ["Keys", "WrittenTask", "merged", "ticks_for"]

Keys = Mapping[str, str]  # beginning of a key of `Task` -> how the file says it
OLD_NAMES = {"boxes": "objects", "kit": "kits"}
EXAMPLE = "[{name: YellowBox, size: 0.05, color: [0.9, 0.7, 0.1]}]"
TICKS_PER_TARGET, LEAST_TICKS = 5, 15
T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class WrittenObject:
    """A cube (`size`: one number), a cuboid (three), a cylinder (`radius` and `height`), or `count` instances of a part."""

    color: Vec3
    name: str = ""
    part: str = ""
    count: int | None = None
    size: float | Vec3 | None = None
    radius: float | None = None
    height: float | None = None
    density: float = 1000.0
    shape: Shape = "cuboid"


@dataclasses.dataclass(frozen=True)
class WrittenKit:
    """A kit; one number is the size of a square one."""

    name: str = "KittingBox"
    size: float | Vec2 = 0.4
    thickness: float = 0.005
    wall_height: float = 0.04
    wall_thickness: float = 0.005
    table: str = ""
    position: Vec2 = (0.0, 0.0)
    slots: tuple[Slot, ...] = ()
    grid: tuple[int, int] | None = None
    dividers: bool = False


@dataclasses.dataclass(frozen=True)
class WrittenTarget:
    """A target with its place, or the slot that says it, as in "TrayA.a1"."""

    object: str
    position: Vec3 | None = None
    frame: str = ""
    turn: float | None = None
    slot: str = ""


NO_KIT, NO_KITS, NO_OBJECTS = WrittenKit(""), (WrittenKit(""),), (WrittenObject((0.0, 0.0, 0.0)),)  # not written
LAYOUT, GENES, EPISODE, WEIGHTS = Layout(), GeneSettings(), Episode(), Weights()


@dataclasses.dataclass(frozen=True)
class WrittenTask:
    """What the file of a task may hold."""

    name: str
    description: str
    tables: tuple[Table, ...]
    targets: tuple[WrittenTarget, ...]
    objects: tuple[WrittenObject, ...] = NO_OBJECTS
    boxes: tuple[WrittenObject, ...] = NO_OBJECTS
    kits: tuple[WrittenKit, ...] = NO_KITS
    kit: WrittenKit = NO_KIT
    layout: Layout = LAYOUT
    genes: GeneSettings = GENES
    episode: Episode = EPISODE
    weights: Weights = WEIGHTS
    subgoals: tuple[Subgoal, ...] = ()
    subgoal_reward: SubgoalReward = "ticked"
    robot_frame: str = "base_link"
    robot_position: Vec3 = (0.0, 1.0, 0.05)
    gripper_opening: float = 0.2
    finger_room: float = 0.0
    faults: Faults | str | None = None
    robot: Robot = STANDING

    def task(self, source: str, *, ticks_given: bool) -> tuple[Task, Keys]:
        """Return the task, with as many ticks as its targets and faults take unless they are given, and how the file names
        its keys.
        Raise UserError, naming `source`, key and remedy, for what is no object, kit or target."""
        objects: list[Object] = []
        written = "objects" if self.boxes is NO_OBJECTS else "boxes"
        if self.boxes is not NO_OBJECTS and self.objects is not NO_OBJECTS:
            raise UserError(
                f"{source}, key boxes: the older name of objects, which is there too; put all under objects"
            )
        if self.boxes is self.objects:
            raise UserError(f"{source}, key objects: missing; add it, for instance objects: {EXAMPLE}")
        keys = {"objects": written}
        for i, one in enumerate(getattr(self, written)):
            for thing in _objects(one, f"{source}, key {written}[{i}]"):
                key = f"objects[{len(objects)}]"
                keys[key] = f"{written}[{i}]"
                if thing.is_cube:
                    keys[f"{key}.size[0]"] = f"{written}[{i}].size"
                elif one.radius is not None:
                    keys[f"{key}.size"] = f"{written}[{i}].radius"
                elif thing.shape == "cylinder":
                    keys |= {f"{key}.{length}": f"{written}[{i}].size" for length in ("radius", "height")}
                objects.append(thing)
        if self.kit is not NO_KIT and self.kits is not NO_KITS:
            raise UserError(
                f"{source}, key kit: the older name of the only one of kits, which is there too; delete one"
            )
        kits = tuple(map(_kit, (self.kit,) if self.kits is NO_KITS else self.kits))
        if self.kit is not NO_KIT:
            keys |= {"kits[0]": "kit", "kits": "kit"}
        keys |= {f"kits[{i}].size[0]": f"{keys.get(f'kits[{i}]', f'kits[{i}]')}.size" for i in range(len(kits))}
        if self.kit is NO_KIT and self.kits is NO_KITS:
            raise UserError(
                f"{source}, key kits: missing; add it, for instance kits: [{{name: KittingBox, size: 0.4}}]"
            )
        named = {thing.part or thing.name: thing for thing in objects} | {thing.name: thing for thing in objects}
        targets = tuple(
            _target(target, kits, named, f"{source}, key targets[{i}]") for i, target in enumerate(self.targets)
        )
        episode = self.episode
        if not ticks_given:
            episode = dataclasses.replace(episode, max_ticks=ticks_for(len(targets)))
        faults = faults_of(self.faults, source)
        if faults is not None:
            longer = episode.with_faults()
            episode = dataclasses.replace(longer, max_ticks=episode.max_ticks) if ticks_given else longer
        same = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(Task) if hasattr(self, field.name)
        }
        new = {"objects": tuple(objects), "kits": kits, "targets": targets, "episode": episode, "faults": faults}
        return Task(**{**same, **new}), keys


def ticks_for(targets: int) -> int:
    """Return how many ticks an episode has for so many targets, unless a task says how many."""
    return max(LEAST_TICKS, TICKS_PER_TARGET * targets)


def merged(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return a task's mapping with what another one says instead, under whichever of two names it says it."""
    for old, new in OLD_NAMES.items():
        for one, other in ((old, new), (new, old)):
            if one in over and other in base:
                base = {key: value for key, value in base.items() if key != other}
    result = dict(base)
    for key, value in over.items():
        both_maps = isinstance(value, dict) and isinstance(base.get(key), dict)
        result[key] = merged(base[key], value) if both_maps else value
    return result


def _objects(one: WrittenObject, where: str) -> Iterator[Object]:
    """Yield an object, or the instances of a part."""
    if not one.name and not one.part:
        raise UserError(
            f"{where}.name: missing; add it, for instance name: YellowBox, or part: Bolt for interchangeable ones"
        )
    if one.count is not None and (one.name or not one.part):
        raise UserError(f"{where}.count: only a part has several instances; write part: instead of name:")
    if one.count is not None and one.count < 1:
        raise UserError(f"{where}.count: {one.count} is too few; write 1 or more")
    if one.radius is not None or one.height is not None:
        if one.size is not None or one.radius is None or one.height is None:
            raise UserError(f"{where}: a cylinder has radius and height, a cuboid has size; write one or the other")
        size = (2 * one.radius, 2 * one.radius, one.height)
        shape: Shape = "cylinder"
    elif one.size is None:
        raise UserError(f"{where}.size: missing; add it, for instance size: 0.05, or radius and height of a cylinder")
    else:
        size, shape = one.size if isinstance(one.size, tuple) else (one.size,) * 3, one.shape
        if shape == "cylinder" and size[0] != size[1]:
            raise UserError(f"{where}.size: a cylinder is as wide as it is deep; write radius and height instead")
    names = [one.name] if one.name else [f"{one.part}{number + 1}" for number in range(one.count or 1)]
    for name in names:
        yield Object(name, size, one.color, one.density, shape, one.part)


def _kit(kit: WrittenKit) -> Kit:
    size = kit.size if isinstance(kit.size, tuple) else (kit.size, kit.size)
    fields = {field.name: getattr(kit, field.name) for field in dataclasses.fields(Kit)}
    return Kit(**{**fields, "size": size})


def _target(target: WrittenTarget, kits: tuple[Kit, ...], things: Mapping[str, Object], where: str) -> Target:
    """Return a target with the place of its slot, if it names one."""
    if not target.slot:
        for key, value in (("position", target.position), ("frame", target.frame)):
            if not value:
                raise UserError(f"{where}.{key}: missing; add it, or name a slot, for instance slot: TrayA.a1")
        assert target.position is not None
        return Target(target.object, target.position, target.frame, target.turn)
    slots = slots_by_name(kits)
    if target.slot not in slots:
        remedy = f"use one of {', '.join(slots)}" if slots else "give a kit slots or a grid"
        raise UserError(f"{where}.slot: there is no slot '{target.slot}'; {remedy}")
    kit, slot = slots[target.slot]
    thing = things.get(target.object)
    if thing is None:
        raise UserError(f"{where}.object: there is no object '{target.object}'; use one of {', '.join(things)}")
    result = Target(target.object, slot_position(kit, slot, thing), kit.name, slot_turn(kit, slot, thing), target.slot)
    given = (
        target.position or result.position,
        target.frame or result.frame,
        result.turn if target.turn is None else target.turn,
    )
    if given != (result.position, result.frame, result.turn):
        raise UserError(f"{where}: the slot {target.slot} says position, frame and turn; leave them out, or the slot")
    return result
