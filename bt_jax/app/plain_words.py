"""Trees in plain words, for people who do not program: "Put GreenBox on top of YellowBox".

Places are described as by a person who faces the robot across the tables (`Task.right`, `Task.away`). Words are
exact within the tolerance of the task; the numbers are in the behavior itself.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from bt_jax.app.units import in_millimetres, length
from bt_jax.behaviors import NOTHING, Behavior, Control, ExtendedNode, Kind, Tree
from bt_jax.tasks import Kit, Object, Slot, Target, Task
from bt_jax.tasks.slots import slot_position, slot_turn

__all__ = ["Words", "differences", "differing_settings", "slot_at"]

NEAR = 0.2  # offsets below this part of an object's shorter side are not mentioned
IN_SLOT = 0.01  # metres from the middle of a slot, within which a place is that slot
SETTINGS: Mapping[str, str] = MappingProxyType(
    {  # of a task, besides its targets and starts
        "objects": "objects",
        "tables": "tables",
        "kits": "kits",
        "genes": "places to try",
        "episode": "length and tolerance of a run",
        "weights": "weights",
        "subgoals": "subgoals",
        "subgoal_reward": "rule for subgoals",
        "robot_position": "place of the robot",
        "gripper_opening": "gripper",
        "finger_room": "room for the fingers",
        "robot": "robot",
    }
)
LEVEL = 0.3  # heights that differ by less than this part of an object's height are the same level
Vec3 = tuple[float, float, float]


@dataclasses.dataclass(frozen=True)
class Words:
    """Puts nodes and places of a task's trees into words; call it with a node."""

    task: Task

    def __call__(self, node: Tree) -> str:
        """Say what a node does or asks."""
        if isinstance(node, Control):
            return "Do all, in this order" if node.kind == Kind.SEQUENCE else "Try in turn, until one works"
        if isinstance(node, ExtendedNode):
            return _extended(node)
        name, thing = node.name, self.named(node.object)
        if name in ("approach", "reachable"):
            what = self._near(node)
            return f"Drive to {what}" if name == "approach" else f"Is {what} within reach?"
        if node.position is not None:
            where = self._where(node)
            texts = {"move": f"Put {thing} {where}", "place": f"Set down {thing} {where}", "at": f"Is {thing} {where}?"}
            return texts.get(name, f"Fetch {thing} and put it {where}")
        match name:
            case "pick":
                return f"Pick up {thing}"
            case "holding":
                return "Is the gripper empty?" if node.object == NOTHING else f"Is {thing} in the gripper?"
            case "gripper":
                return f"Is the gripper {node.args[0]}?"
            case "clear" if self._is_part(node.object):
                return f"Is there {thing} with nothing on it?"
            case "clear":
                return f"Is nothing on {thing}?"
            case "is_seen":
                return f"Is {thing} in sight?"
            case "look":
                return f"Wait until {thing} is in sight"
            case "reached":
                return f"Was “{_spoken(node.args[0])}” reached before?"
            case "subtask":
                return f"Do “{_spoken(node.args[0])}” as a whole"
        return f"{name.removesuffix('_gripper').capitalize()} the gripper"

    def statement(self, condition: Behavior) -> str:
        """Say a condition as a statement: "GreenBox is on top of YellowBox"."""
        name, thing = condition.name, self.named(condition.object)
        if name == "reachable":
            return f"{self._near(condition)} is within reach"
        if condition.position is not None:
            return f"{thing} is {self._where(condition)}"
        match name:
            case "holding":
                return "the gripper is empty" if condition.object == NOTHING else f"{thing} is in the gripper"
            case "gripper":
                return f"the gripper is {condition.args[0]}"
            case "clear" if self._is_part(condition.object):
                return f"there is {thing} with nothing on it"
            case "clear":
                return f"nothing is on {thing}"
        return f"“{_spoken(condition.args[0])}” was reached before"

    def named(self, name: object) -> str:
        """Return how an object is called in a sentence, and one of a part: "GreenBox", "a Bolt"."""
        if not self._is_part(name):
            return str(name)
        return f"{'an' if str(name)[0] in 'AEIOUaeiou' else 'a'} {name}"

    @property
    def things(self) -> str:
        """Return what the task's objects are called together."""
        return "boxes" if self.task.all_cubes else "objects"

    @property
    def thing(self) -> str:
        """Return what one of the task's objects is called."""
        return "box" if self.task.all_cubes else "object"

    @property
    def a_thing(self) -> str:
        return f"{'a' if self.task.all_cubes else 'an'} {self.thing}"

    def kit(self, name: str) -> str:
        """Return how a kit is called: by its name, unless there is only one, without slots."""
        return "the kit" if len(self.task.kits) == 1 and not self.task.kits[0].places else name

    def target(self, target: Target) -> str:
        """Say where a target is, and how its object should lie."""
        return self.place(target.object, target.position, target.frame, target.turn)

    def place(self, thing: str, position: Vec3, frame: str, turn: float | None = None) -> str:
        """Say where `thing` is with its centre at `position` [m] in `frame`, and how far it is turned [degrees]: "on top of
        YellowBox", "in slot a1 of TrayA". If the task does not have the thing or the frame, say it in numbers."""
        turned = "" if turn is None else f", turned by {turn:g} degrees"
        if thing not in self.task.instances or frame not in self.task.frames:
            return f"at {_numbers(position)} mm from {frame}{turned}"
        one = self.task.thing(thing)
        if frame in self.task.kit_names:
            kit = self.task.kits[self.task.kit_names.index(frame)]
            slot = slot_at(kit, one, position)
            if slot is not None:
                own = slot_turn(kit, slot, one)
                as_the_slot = turn is None or (own is not None and (turn - own) % (one.symmetry or 1) == 0)
                return f"in slot {slot.name} of {frame}{'' if as_the_slot else turned}"
            return f"{self._in_kit(one, position, kit)}{turned}"
        if frame == self.task.robot_frame:
            return f"{self._on_table(one, position)}{turned}"
        return f"{self._by_object(one, position, self.task.thing(frame), turn)}{turned}"

    def _is_part(self, name: object) -> bool:
        return name in self.task.instances and name not in self.task.object_names

    def _near(self, node: Behavior) -> str:
        """Say what a robot that drives is to reach: an object, a kit, or a place in a frame."""
        if node.position is not None:
            return f"the place at {_numbers(node.position)} mm from {node.object}"
        return self.kit(str(node.object)) if node.object in self.task.kit_names else self.named(node.object)

    def _where(self, node: Behavior) -> str:
        return self.place(str(node.object), node.position or (0.0, 0.0, 0.0), str(node.frame), node.turn)

    def _seen(self, position: Sequence[float]) -> tuple[float, float]:
        """Return how far to the right and how far away, metres."""
        right, away = (
            sum(a * b for a, b in zip(position, axis, strict=True)) for axis in (self.task.right, self.task.away)
        )
        return right, away

    def _by_object(self, thing: Object, position: Vec3, other: Object, turn: float | None) -> str:
        size, frame = min(thing.size[:2]), other.name
        right, away = self._seen(position)
        above = position[2] - (thing.height + other.height) / 2
        level = position[2] - (thing.height - other.height) / 2
        if max(abs(right), abs(away)) < NEAR * size:
            if abs(above) < LEVEL * thing.height:
                return f"on top of {frame}"
            if above > 0:
                return f"{length(above)} above {frame}"
        if abs(level) < LEVEL * thing.height and min(abs(right), abs(away)) < NEAR * size:
            along = self.task.right if abs(right) > abs(away) else self.task.away
            reach = [a + b for a, b in zip(thing.half_at(turn), other.half_at(None), strict=True)]
            gap = max(abs(right), abs(away)) - abs(sum(a * b for a, b in zip(reach, along, strict=True)))
            side = ("right of" if right > 0 else "left of") if abs(right) > abs(away) else None
            side = side or ("behind" if away > 0 else "in front of")
            return f"{side} {frame}" + (f", {length(gap)} away" if gap > 0.05 * size else "")
        raised = f" and {length(abs(level))} {'higher' if level > 0 else 'lower'}"
        return f"{self._offset(right, away, size)} {frame}" + (raised if abs(level) >= LEVEL * thing.height else "")

    def _in_kit(self, thing: Object, position: Vec3, kit: Kit) -> str:
        size, called = min(thing.size[:2]), self.kit(kit.name)
        right, away = self._seen(position)
        raised = position[2] - kit.plate - thing.height / 2
        height = f", {length(raised)} up" if raised >= LEVEL * thing.height else ""
        if max(abs(right), abs(away)) < NEAR * size:
            return f"in the middle of {called}{height}"
        pitch = self.task.genes.pitch
        cells = [round(x / pitch) if pitch else 0 for x in (right, away)]
        spread = (self.task.genes.grid - 1) // 2
        close = all(abs(x - c * pitch) < NEAR * size for x, c in zip((right, away), cells, strict=True))
        if spread == 1 and close and max(map(abs, cells)) == 1:
            side, depth = {-1: "left", 0: "", 1: "right"}[cells[0]], {-1: "front", 0: "", 1: "back"}[cells[1]]
            if side and depth:
                return f"in the {depth} {side} corner of {called}{height}"
            return f"at the {side or depth} of {called}{height}"
        return f"{self._offset(right, away, size)} the middle of {called}{height}"

    def _on_table(self, thing: Object, position: Vec3) -> str:
        """Say a place in the robot's frame by the table that is there."""
        size = min(thing.size[:2])
        point = [a + b for a, b in zip(position, self.task.robot_position, strict=True)]
        for table in self.task.tables:
            offset = [a - b for a, b in zip(point, table.position, strict=True)]
            if all(abs(offset[k]) <= table.size[k] / 2 for k in (0, 1)):
                right, away = self._seen(offset)
                raised = point[2] - thing.height / 2 - table.top
                height = f", {length(raised)} up" if raised >= LEVEL * thing.height else ""
                if max(abs(right), abs(away)) < NEAR * size:
                    return f"in the middle of {table.name}{height}"
                return f"on {table.name}, {self._offset(right, away, size)} its middle{height}"
        return f"at {_numbers(position)} mm from the robot"

    def _offset(self, right: float, away: float, size: float) -> str:
        """ "50 mm right of and 30 mm behind" """
        parts = []
        if abs(right) >= NEAR * size:
            parts.append(f"{length(abs(right))} {'right' if right > 0 else 'left'} of")
        if abs(away) >= NEAR * size:
            parts.append(f"{length(abs(away))} {'behind' if away > 0 else 'in front of'}")
        return " and ".join(parts) or "at"


def _extended(node: ExtendedNode[Behavior]) -> str:
    """Say what a node does that is neither a Sequence nor a Fallback."""
    number = node.number or 0
    times = "again and again" if number == -1 else f"up to {number} times"
    return {
        "ResumingSequence": "Do all, in this order, going on where it was",
        "ResumingFallback": "Try in turn, going on where it was, until one works",
        "SequenceWithMemory": "Do all, in this order, each only once",
        "Inverter": "The opposite of this",
        "ForceSuccess": "Try this; it may fail",
        "ForceFailure": "Do this, and count it as failed",
        "retry": f"Try this {times}, until it works",
        "timeout": f"Give up if this takes {number} steps",
        "RetryUntilSuccessful": f"Try this {times}, until it works",
        "Repeat": "Do this again and again" if number == -1 else f"Do this {number} times",
        "Timeout": f"Do this within {number / 1000:g} seconds" if number else "Do this",
        "KeepRunningUntilFailure": "Do this again and again, until it fails",
    }[node.name]


def differences(one: Task, other: Task) -> list[str]:
    """Say in what the goal of a task differs from that of another with the same objects: "GreenBox on top of YellowBox"."""
    words, said = Words(one), []
    for name in dict.fromkeys([*one.object_names, *one.kinds]):
        ours, theirs = ([target for target in task.targets if target.object == name] for task in (one, other))
        said += [f"{words.named(name)} {words.target(target)}" for target in ours if target not in theirs]
        if not ours and theirs:
            said.append(f"{words.named(name)} may be anywhere")
        elif len(ours) < len(theirs):
            said += [f"no {name} has to be {words.target(target)}" for target in theirs if target not in ours]
    if one.layout != other.layout:
        same_kind = bool(one.layout.fixed) == bool(other.layout.fixed)
        places = "in fixed places" if one.layout.fixed else "at random"
        said.append(f"{words.things} start {places}{', others' if same_kind else ''}")
    return said


def differing_settings(one: Task, other: Task) -> list[str]:
    """Name what differs between two tasks besides their targets and starts: "weights"."""
    return [words for key, words in SETTINGS.items() if getattr(one, key) != getattr(other, key)]


def slot_at(kit: Kit, thing: Object, position: Vec3) -> Slot | None:
    """Return the slot in which an object stands with its centre at a position in a kit's frame, None if in none."""
    places = [slot for slot in kit.places if math.dist(slot_position(kit, slot, thing), position) < IN_SLOT]
    return min(places, key=lambda slot: math.dist(slot.position, position[:2]), default=None)


def _numbers(position: Vec3) -> str:
    return ", ".join(f"{axis} {in_millimetres(value):.0f}" for axis, value in zip("xyz", position, strict=True))


def _spoken(name: object) -> str:
    return str(name).replace("_", " ")
