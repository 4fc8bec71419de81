"""Goals as sentences: "GreenBox on top of YellowBox", "a Bolt in slot a1 of TrayA".

What `plain_words` prints is read back, and so is what people write instead: "any Bolt into TrayA a1".

A printed length is rounded to a millimetre, and short ones are not printed. Where the place that is exactly as far away as
is said would be described otherwise, one of those that the sentence may stand for is taken that would not.
"""

from __future__ import annotations

import dataclasses
import difflib
import itertools
import re
from collections.abc import Callable, Iterator, Sequence

from bt_jax._util.errors import UserError
from bt_jax.app.plain_words import Words
from bt_jax.tasks import Kit, Object, Table, Target, Task
from bt_jax.tasks.slots import fits, slot_position, slot_turn
from bt_jax.tasks.things import Vec3

__all__ = ["completions", "goal_sentence", "read_goal"]

LENGTH = r"([\d.]+) ?(mm|cm|m)\b"
ACROSS, ALONG = rf"{LENGTH} (?:to the )?(right|left) of", rf"{LENGTH} (behind|in front of)"
OFFSET = rf"(?:{ACROSS}(?: and {ALONG})?|{ALONG}|at)"
UP, NAME, NUMBER = rf"(?:, {LENGTH} up)?", r"(the kit|\w+)", r"(-?[\d.]+)"
TURN = re.compile(r",? turned(?: by)? (-?[\d.]+(?:e-?\d+)?) ?(?:degrees?|°)$", re.I)
METRES = {"mm": 0.001, "cm": 0.01, "m": 1.0}
AXES = {"right": (1.0, 0.0), "left": (-1.0, 0.0), "back": (0.0, 1.0), "front": (0.0, -1.0)}
SIDES = {**AXES, "behind": AXES["back"], "in front of": AXES["front"]}
ROUNDED = (0.0, 0.0004, -0.0004)  # metres that a printed length may be away from what it stands for
UNSAID = (0.0, 0.012, -0.012)  # metres of a length that is not printed, where nothing at all would be in a slot
SAME = {"into": "in", "onto": "on", "any": "", "a": "", "an": "", "the": "", "put": "", "slot": "", "of": "", "to": ""}
Groups = Sequence[str | None]


def goal_sentence(task: Task, target: Target) -> str:
    """Return where something should be, as the page prints it."""
    words = Words(task)
    return f"{words.named(target.object)} {words.target(target)}"


def read_goal(task: Task, sentence: str) -> Target:
    """Return the target that a sentence says. Raise UserError if it says none."""
    text = " ".join(sentence.split()).rstrip(".!")
    thing, rest = _thing(task, text)
    turned = TURN.search(rest)
    turn = None if turned is None else _number(turned[1])
    place = rest if turned is None else rest[: turned.start()]
    for pattern, read in FORMS:
        found = re.fullmatch(pattern, place, re.I)
        if found is not None:
            return _nearest(task, text, read(_Goal(task, thing, turn), found.groups()))
    raise UserError(f"“{rest or text}” is no place; write for instance: {_example(task)}")


def completions(task: Task, text: str, most: int = 6) -> list[str]:
    """Return sentences that what a person has begun to write may become; words may be left out."""
    typed, found = _plain(text), []
    for sentence in _sentences(task):
        words = _plain(sentence)
        if all(any(word.startswith(one) for word in words) for one in typed):
            found.append((bool(typed) and not words[0].startswith(typed[0]), sentence))
    return [sentence for _, sentence in sorted(found, key=lambda one: one[0])][:most]


@dataclasses.dataclass(frozen=True)
class _Goal:
    """What should be somewhere, and how it should lie there."""

    task: Task
    thing: str
    turn: float | None

    @property
    def one(self) -> Object:
        return self.task.thing(self.thing)

    def vector(self, right: float, away: float, up: float) -> Vec3:
        """Return so many metres to the right, away and up, seen by a person who faces the robot."""
        along = zip(self.task.right, self.task.away, (0.0, 0.0, 1.0), strict=True)
        x, y, z = (right * a + away * b + up * c for a, b, c in along)
        return x, y, z

    def at(self, frame: str, position: Vec3, slot: str = "") -> Target:
        x, y, z = (round(value, 6) + 0.0 for value in position)
        return Target(self.thing, (x, y, z), frame, self.turn, slot)


@dataclasses.dataclass(frozen=True)
class _Reading:
    """A target that depends on lengths, metres, as they stand in a sentence."""

    lengths: tuple[float, ...]
    target: Callable[[Sequence[float]], Target]


def _nearest(task: Task, text: str, reading: _Reading) -> Target:
    """Return the target of the lengths as written or, if only that prints the sentence, of others that round to them."""
    first = reading.target(reading.lengths)
    if not reading.lengths or goal_sentence(task, first) == text:
        return first
    for some in itertools.product(*(ROUNDED if length else UNSAID for length in reading.lengths)):
        target = reading.target([a + b for a, b in zip(reading.lengths, some, strict=True)])
        if goal_sentence(task, target) == text:
            return target
    return first


def _numbers(goal: _Goal, groups: Groups) -> _Reading:
    *values, unit, name = groups
    frame = goal.task.robot_frame if _lower(name) == "the robot" else _named(goal.task, name, goal.task.frames)
    x, y, z = (_metres(value, unit) for value in values)
    return _Reading((), lambda _: goal.at(frame, (x, y, z)))


def _in_slot(goal: _Goal, groups: Groups) -> _Reading:
    slot_name, kit_name = groups
    kit = _kit(goal.task, kit_name)
    slot = next((one for one in kit.places if one.name.lower() == _lower(slot_name)), None)
    if slot is None:
        known = ", ".join(one.name for one in kit.places)
        remedy = f"use one of {known}" if known else "add slots to it"
        raise UserError(f"{kit.name} has no slot {slot_name}; {remedy}")
    own = slot_turn(kit, slot, goal.one)
    as_the_slot = goal.turn is None or (own is not None and (goal.turn - own) % (goal.one.symmetry or 1) == 0)
    goal = dataclasses.replace(goal, turn=own) if as_the_slot else goal
    name = f"{kit.name}.{slot.name}" if as_the_slot else ""
    return _Reading((), lambda _: goal.at(kit.name, slot_position(kit, slot, goal.one), name))


def _in_slot_of(goal: _Goal, groups: Groups) -> _Reading:
    return _in_slot(goal, groups[::-1])


def _in_the_middle(goal: _Goal, groups: Groups) -> _Reading:
    name, *up = groups
    return _from_middle(goal, name, [None] * 6, up)


def _at_a_side(goal: _Goal, groups: Groups) -> _Reading:
    *sides, name, length, unit = groups
    kit, pitch = _kit(goal.task, name), goal.task.genes.pitch
    right, away = (pitch * sum(AXES[_lower(side)][k] for side in sides if side) for k in (0, 1))
    base = kit.plate + goal.one.height / 2
    return _Reading((_metres(length, unit),), lambda up: goal.at(kit.name, goal.vector(right, away, base + up[0])))


def _off_the_middle(goal: _Goal, groups: Groups) -> _Reading:
    *offset, name, length, unit = groups
    return _from_middle(goal, name, _six(offset), [length, unit])


def _on_a_table(goal: _Goal, groups: Groups) -> _Reading:
    name, *offset, length, unit = groups
    return _from_middle(goal, name, _six(offset), [length, unit])


def _from_middle(goal: _Goal, name: str | None, offset: Groups, up: Groups) -> _Reading:
    """Read a place that is told from the middle of a kit or of a table."""
    task = goal.task
    where = _kit_or_table(task, name)
    (right, toward), (away, along) = _offsets(offset)
    lengths = (right, away, _metres(*up) if up else 0.0)

    def target(values: Sequence[float]) -> Target:
        x, y, z = goal.vector(toward * values[0], along * values[1], values[2] + goal.one.height / 2)
        if isinstance(where, Kit):
            return goal.at(where.name, (x, y, z + where.plate))
        origin = [a - b for a, b in zip((*where.position[:2], where.top), task.robot_position, strict=True)]
        return goal.at(task.robot_frame, (x + origin[0], y + origin[1], z + origin[2]))

    return _Reading(lengths, target)


def _on_top(goal: _Goal, groups: Groups) -> _Reading:
    (name,) = groups
    where = {one.lower() for one in (*goal.task.kit_names, *(table.name for table in goal.task.tables))}
    if _lower(name) in where or _lower(name) == "the kit":
        return _from_middle(goal, name, [None] * 6, [])
    return _above(goal, ["0", "m", name])


def _above(goal: _Goal, groups: Groups) -> _Reading:
    length, unit, name = groups
    other = _other(goal.task, name)
    base = (goal.one.height + other.height) / 2
    return _Reading((_metres(length, unit),), lambda up: goal.at(other.name, (0.0, 0.0, base + up[0])))


def _beside(goal: _Goal, groups: Groups) -> _Reading:
    across, along, name, length, unit = groups
    right, away = SIDES[_lower(across or along)]
    other = _other(goal.task, name)
    reach = [a + b for a, b in zip(goal.one.half_at(goal.turn), other.half_at(None), strict=True)]
    axis = goal.vector(abs(right), abs(away), 0.0)
    beside = abs(sum(a * b for a, b in zip(reach, axis, strict=True)))
    level = (goal.one.height - other.height) / 2

    def target(values: Sequence[float]) -> Target:
        return goal.at(other.name, goal.vector(right * (beside + values[0]), away * (beside + values[0]), level))

    return _Reading((_metres(length, unit),), target)


def _around(goal: _Goal, groups: Groups) -> _Reading:
    *offset, name, length, unit, direction = groups
    other = _other(goal.task, name)
    (right, toward), (away, along) = _offsets(_six(offset))
    level, up = (goal.one.height - other.height) / 2, -1.0 if _lower(direction) == "lower" else 1.0

    def target(values: Sequence[float]) -> Target:
        return goal.at(other.name, goal.vector(toward * values[0], along * values[1], level + up * values[2]))

    return _Reading((right, away, _metres(length, unit)), target)


FORMS: tuple[tuple[str, Callable[[_Goal, Groups], _Reading]], ...] = (
    (rf"at x {NUMBER}, y {NUMBER}, z {NUMBER} (mm|cm|m) from (the robot|\w+)", _numbers),
    (rf"(?:in|into|at|to) (?:the )?middle of {NAME}{UP}", _in_the_middle),
    (rf"(?:in|into|at) the (front|back) (left|right) corner of {NAME}{UP}", _at_a_side),
    (rf"at the (left|right|front|back)() of {NAME}{UP}", _at_a_side),
    (r"(?:in|into|to) (?!front of|the (?:left|right) of)(?:the )?(?:slot )?([\w-]+) of (\w+)", _in_slot),
    (r"(?:in|into|to) (?!the\b)(\w+)(?:[ .]| slot )([\w-]+)", _in_slot_of),
    (rf"{OFFSET} the middle of {NAME}{UP}", _off_the_middle),
    (rf"on {NAME}, {OFFSET} its middle{UP}", _on_a_table),
    (rf"(?:on top of|on|onto|in|into) {NAME}", _on_top),
    (rf"{LENGTH} above (\w+)", _above),
    (rf"(?:(?:to the )?(right|left) of|(behind|in front of)) (\w+)(?:, {LENGTH} away)?", _beside),
    (rf"{OFFSET} (\w+)(?: and {LENGTH} (higher|lower))?", _around),
)


def _six(groups: Groups) -> Groups:
    """Return the length, unit and side across, and those along, of an offset, however it was written."""
    across, along, only = groups[:3], groups[3:6], groups[6:9]
    return [*across, *(along if along[0] is not None else only)]


def _offsets(groups: Groups) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return how far to the right and how far away, each as a length and a sign."""
    right = SIDES[_lower(groups[2])][0] if groups[2] else 1.0
    away = SIDES[_lower(groups[5])][1] if groups[5] else 1.0
    return (_metres(*groups[:2]), right), (_metres(*groups[3:5]), away)


def _metres(length: str | None, unit: str | None) -> float:
    return 0.0 if length is None or unit is None else _number(length) * METRES[_lower(unit)]


def _number(text: str | None) -> float:
    try:
        return float(text or 0)
    except ValueError:
        raise UserError(f"{text} is not a number; write for instance 35 mm") from None


def _lower(text: str | None) -> str:
    return (text or "").lower()


def _thing(task: Task, text: str) -> tuple[str, str]:
    """Return what a sentence is about, and the rest of it."""
    known = [*task.kinds, *task.object_names]
    for pattern in (r"(?:put )?(\w+)\b(.*)", r"(?:put )?(?:an?|any|one|the) (\w+)\b(.*)"):
        found = re.fullmatch(pattern, text, re.I)
        if found is not None and found[1].lower() in map(str.lower, known):
            rest = re.sub(r"^\s*(should be|is|goes|go)\b", "", found[2], flags=re.I)
            return _named(task, found[1], known), rest.strip()
    raise UserError(f"the sentence has to begin with what is to be moved; write for instance: {_example(task)}")


def _named(task: Task, name: str | None, known: Sequence[str]) -> str:
    """Return a name as the task writes it."""
    found = next((one for one in known if one.lower() == _lower(name)), None)
    if found is None:
        near = difflib.get_close_matches(str(name), known, n=1) or [", ".join(known)]
        raise UserError(f"there is no {name} here; use {near[0]}")
    return found


def _kit(task: Task, name: str | None) -> Kit:
    if _lower(name) == "the kit" and len(task.kits) == 1:
        return task.kits[0]
    return task.kits[task.kit_names.index(_named(task, name, task.kit_names))]


def _kit_or_table(task: Task, name: str | None) -> Kit | Table:
    table = next((one for one in task.tables if one.name.lower() == _lower(name)), None)
    return _kit(task, name) if table is None else table


def _other(task: Task, name: str | None) -> Object:
    """Return the object that a place is told from."""
    part = next((one for one in task.kinds if one.lower() == _lower(name)), None)
    if part is not None and part not in task.object_names:
        raise UserError(f"there are several {part}; say which: {', '.join(task.instances[part])}")
    return task.thing(_named(task, name, task.object_names))


def _plain(text: str) -> list[str]:
    words = re.findall(r"[\w-]+", text.lower())
    return [one for one in (SAME.get(word, word) for word in words) if one]


def _sentences(task: Task) -> Iterator[str]:
    """Yield sentences that make sense, first of what has no target yet."""
    words, wanted = Words(task), [target.object for target in task.targets]
    for kind in sorted(task.kinds, key=wanted.__contains__):
        thing, named = task.thing(kind), words.named(kind)
        for kit in task.kits:
            yield from (f"{named} in slot {slot.name} of {kit.name}" for slot in kit.places if fits(kit, slot, thing))
            if not kit.places:
                yield f"{named} in the middle of {words.kit(kit.name)}"
        others = [one.name for one in task.objects if one.name != kind and len(task.instances.get(one.part, ())) < 2]
        for other in others:
            yield f"{named} on top of {other}"
        for other in others:
            yield from (f"{named} {side} {other}" for side in ("left of", "right of", "in front of", "behind"))
        yield from (f"{named} in the middle of {table.name}" for table in task.tables)


def _example(task: Task) -> str:
    return next(_sentences(task), "GreenBox on top of YellowBox")
