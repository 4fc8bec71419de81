"""Trees in plain words, for people who do not program: "Put GreenBox on top of YellowBox".

Places are described as by a person who faces the robot across the tables (`Task.right`, `Task.away`). Words are
exact within the tolerance of the task; the numbers are in the behavior itself.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

from bt_jax.behaviors import NOTHING, Behavior, Control, ExtendedNode, Kind, Tree
from bt_jax.tasks import Task

__all__ = ["Words", "differences", "differing_settings"]

NEAR = 0.2  # offsets below this part of a box's size are not mentioned
SETTINGS: Mapping[str, str] = MappingProxyType(
    {  # of a task, besides its targets and starts
        "tables": "tables",
        "kit": "kit",
        "genes": "places to try",
        "episode": "length and tolerance of an episode",
        "weights": "weights",
        "subgoals": "subgoals",
        "subgoal_reward": "rule for subgoals",
        "robot_position": "place of the robot",
        "gripper_opening": "gripper",
    }
)
LEVEL = 0.3  # heights that differ by less than this part of a box's size are the same level
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
        name, thing = node.name, node.object
        if node.position is not None:
            where = self._where(node)
            texts = {"move": f"Put {thing} {where}", "place": f"Set down {thing} {where}", "at": f"Is {thing} {where}?"}
            return texts[name]
        match name:
            case "pick":
                return f"Pick up {thing}"
            case "holding":
                return "Is the gripper empty?" if thing == NOTHING else f"Is {thing} in the gripper?"
            case "gripper":
                return f"Is the gripper {node.args[0]}?"
            case "reachable":
                return f"Is {thing} within reach?"
            case "clear":
                return f"Is nothing on {thing}?"
            case "reached":
                return f"Was “{_spoken(node.args[0])}” reached before?"
            case "subtask":
                return f"Do “{_spoken(node.args[0])}” as a whole"
        return f"{name.removesuffix('_gripper').capitalize()} the gripper"

    def statement(self, condition: Behavior) -> str:
        """Say a condition as a statement: "GreenBox is on top of YellowBox"."""
        name, thing = condition.name, condition.object
        if condition.position is not None:
            return f"{thing} is {self._where(condition)}"
        match name:
            case "holding":
                return "the gripper is empty" if thing == NOTHING else f"{thing} is in the gripper"
            case "gripper":
                return f"the gripper is {condition.args[0]}"
            case "reachable":
                return f"{thing} is within reach"
            case "clear":
                return f"nothing is on {thing}"
        return f"“{_spoken(condition.args[0])}” was reached before"

    def place(self, thing: str, position: Vec3, frame: str) -> str:
        """Say where `thing` is with its centre at `position` [m] in `frame`: "on top of YellowBox". If the task does not
        have the thing or the frame, say it in numbers."""
        if thing not in self.task.object_names or frame not in self.task.frames:
            return f"at {_numbers(position)} cm from {frame}"
        if frame == self.task.kit.name:
            return self._in_kit(thing, position)
        if frame == self.task.robot_frame:
            return self._on_table(thing, position)
        return self._by_box(thing, position, frame)

    def _where(self, node: Behavior) -> str:
        return self.place(str(node.object), node.position or (0.0, 0.0, 0.0), str(node.frame))

    def _seen(self, position: Sequence[float]) -> tuple[float, float]:
        """Return how far to the right and how far away, metres."""
        right, away = (
            sum(a * b for a, b in zip(position, axis, strict=True)) for axis in (self.task.right, self.task.away)
        )
        return right, away

    def _by_box(self, thing: str, position: Vec3, frame: str) -> str:
        size, other = self.task.edge(thing), self.task.edge(frame)
        right, away = self._seen(position)
        above = position[2] - (size + other) / 2
        level = position[2] - (size - other) / 2
        if max(abs(right), abs(away)) < NEAR * size:
            if abs(above) < LEVEL * size:
                return f"on top of {frame}"
            if above > 0:
                return f"{_length(above)} above {frame}"
        if abs(level) < LEVEL * size and min(abs(right), abs(away)) < NEAR * size:
            gap = max(abs(right), abs(away)) - (size + other) / 2
            side = ("right of" if right > 0 else "left of") if abs(right) > abs(away) else None
            side = side or ("behind" if away > 0 else "in front of")
            return f"{side} {frame}" + (f", {_length(gap)} away" if gap > 0.05 * size else "")
        raised = f" and {_length(abs(level))} {'higher' if level > 0 else 'lower'}"
        return f"{self._offset(right, away, size)} {frame}" + (raised if abs(level) >= LEVEL * size else "")

    def _in_kit(self, thing: str, position: Vec3) -> str:
        kit, size = self.task.kit, self.task.edge(thing)
        right, away = self._seen(position)
        raised = position[2] - (kit.thickness + size) / 2
        height = f", {_length(raised)} up" if raised >= LEVEL * size else ""
        if max(abs(right), abs(away)) < NEAR * size:
            return f"in the middle of the kit{height}"
        pitch = self.task.genes.pitch
        cells = [round(x / pitch) if pitch else 0 for x in (right, away)]
        spread = (self.task.genes.grid - 1) // 2
        close = all(abs(x - c * pitch) < NEAR * size for x, c in zip((right, away), cells, strict=True))
        if spread == 1 and close and max(map(abs, cells)) == 1:
            side, depth = {-1: "left", 0: "", 1: "right"}[cells[0]], {-1: "front", 0: "", 1: "back"}[cells[1]]
            if side and depth:
                return f"in the {depth} {side} corner of the kit{height}"
            return f"at the {side or depth} of the kit{height}"
        return f"{self._offset(right, away, size)} the middle of the kit{height}"

    def _on_table(self, thing: str, position: Vec3) -> str:
        """Say a place in the robot's frame by the table that is there."""
        size = self.task.edge(thing)
        point = [a + b for a, b in zip(position, self.task.robot_position, strict=True)]
        for table in self.task.tables:
            offset = [a - b for a, b in zip(point, table.position, strict=True)]
            if all(abs(offset[k]) <= table.size[k] / 2 for k in (0, 1)):
                right, away = self._seen(offset)
                raised = point[2] - size / 2 - table.top
                height = f", {_length(raised)} up" if raised >= LEVEL * size else ""
                if max(abs(right), abs(away)) < NEAR * size:
                    return f"in the middle of {table.name}{height}"
                return f"on {table.name}, {self._offset(right, away, size)} its middle{height}"
        return f"at {_numbers(position)} cm from the robot"

    def _offset(self, right: float, away: float, size: float) -> str:
        """ "5 cm right of and 3 cm behind" """
        parts = []
        if abs(right) >= NEAR * size:
            parts.append(f"{_length(abs(right))} {'right' if right > 0 else 'left'} of")
        if abs(away) >= NEAR * size:
            parts.append(f"{_length(abs(away))} {'behind' if away > 0 else 'in front of'}")
        return " and ".join(parts) or "at"


def _extended(node: ExtendedNode[Behavior]) -> str:
    """Say what a node does that is not in trees that are learnt."""
    number = node.number or 0
    times = "again and again" if number == -1 else f"up to {number} times"
    return {
        "ResumingSequence": "Do all, in this order, going on where it was",
        "ResumingFallback": "Try in turn, going on where it was, until one works",
        "SequenceWithMemory": "Do all, in this order, each only once",
        "Inverter": "The opposite of this",
        "ForceSuccess": "Try this; it may fail",
        "ForceFailure": "Do this, and count it as failed",
        "RetryUntilSuccessful": f"Try this {times}, until it works",
        "Repeat": "Do this again and again" if number == -1 else f"Do this {number} times",
        "Timeout": f"Do this within {number / 1000:g} seconds" if number else "Do this",
        "KeepRunningUntilFailure": "Do this again and again, until it fails",
    }[node.name]


def differences(one: Task, other: Task) -> list[str]:
    """Say in what the goal of a task differs from that of another with the same boxes: "GreenBox on top of YellowBox"."""
    words, theirs = Words(one), {target.object: target for target in other.targets}
    ours = {target.object: target for target in one.targets}
    said = []
    for name in one.object_names:
        target = ours.get(name)
        if target == theirs.get(name):
            continue
        place = "may be anywhere" if target is None else words.place(name, target.position, target.frame)
        said.append(f"{name} {place}")
    if one.layout != other.layout:
        same_kind = bool(one.layout.fixed) == bool(other.layout.fixed)
        places = "in fixed places" if one.layout.fixed else "at random"
        said.append(f"boxes start {places}{', others' if same_kind else ''}")
    return said


def differing_settings(one: Task, other: Task) -> list[str]:
    """Name what differs between two tasks besides their boxes, targets and starts: "weights"."""
    return [words for key, words in SETTINGS.items() if getattr(one, key) != getattr(other, key)]


def _length(metres: float) -> str:
    return f"{math.floor(round(1000 * metres, 3) + 0.5) / 10:g} cm"


def _numbers(position: Vec3) -> str:
    return ", ".join(
        f"{axis} {100 * value:.1f}".removesuffix(".0") for axis, value in zip("xyz", position, strict=True)
    )


def _spoken(name: object) -> str:
    return str(name).replace("_", " ")
