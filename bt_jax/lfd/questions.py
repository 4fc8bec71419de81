"""What the demonstrations leave open, as questions: each answer is all that is learnt with it.

A question is asked only where two answers give trees that do different things in some layout of the task, which is found out
by running both. `question_words` puts them into words.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Collection, Iterator, Sequence
from typing import Literal, get_args

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior
from bt_jax.lfd.clustering import NEEDED, observe
from bt_jax.lfd.corrections import Corrections, Instance
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import LearntSubtask, Lesson, learn
from bt_jax.lfd.rehearsal import Rehearsal, first_difference, parting, rehearse
from bt_jax.lfd.turns import doubtful_turn
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = [
    "Answer",
    "Answered",
    "Question",
    "QuestionKind",
    "Value",
    "answered",
    "open_questions",
    "task_of",
    "with_answer",
]

QuestionKind = Literal["frame", "turn", "step", "order", "instance"]
KINDS: tuple[QuestionKind, ...] = get_args(QuestionKind)
ASKED = 1 << 23  # seeds of layouts in which answers are compared; nothing else uses them
LAYOUTS = 8  # in which two answers that do the same count as one
SURE = 4  # demonstrations that show the same order, from which it is taken as meant
Value = str | float | bool | None


@dataclasses.dataclass(frozen=True)
class Answer:
    """What is learnt if `value` is right, as `corrections` say. Values: of a frame its name; of a turn its degrees, None
    for any; of a step or an order whether it is meant; of an instance its name, or the name of its part for any. `shows` is
    the state (a batch of one) after the first move that only this answer makes, in a layout in which the answers part."""

    value: Value
    corrections: Corrections
    lesson: Lesson
    shows: World = dataclasses.field(repr=False, compare=False)


@dataclasses.dataclass(frozen=True)
class Question:
    """What is open about actions of a lesson, the `subject`, by their indices among its inferences: what a place is relative
    to, how the object is turned there, whether a step on the way is meant, whether one place is before another, or which
    instance is meant. The first answer is the one that is taken meanwhile."""

    kind: QuestionKind
    subject: tuple[int, ...]
    answers: tuple[Answer, ...]


@dataclasses.dataclass(frozen=True)
class Answered:
    """What a person has said, as a question would ask it. The subject of an instance is empty; `corrections` say it, and may
    be taken back."""

    kind: QuestionKind
    subject: tuple[int, ...]
    value: Value
    corrections: Corrections


@dataclasses.dataclass(frozen=True)
class _Doubt:
    """What may be asked: answers as values with their corrections, the one that is taken meanwhile first."""

    kind: QuestionKind
    subject: tuple[int, ...]
    answers: tuple[tuple[Value, Corrections], ...]


def open_questions(
    lesson: Lesson, layouts: World | None = None, *, kinds: Collection[QuestionKind] = KINDS
) -> tuple[Question, ...]:
    """Return what the demonstrations of a lesson leave open, of these kinds; nothing that a person has answered, and nothing
    while they are too few to infer anything. Answers that do the same in all `layouts` of the task (NumPy; default: some
    random ones) are one."""
    if lesson.missing:
        return ()
    layouts = sample_layouts(lesson.task, ASKED, LAYOUTS) if layouts is None else layouts
    meanwhile = rehearse(lesson.tree, task_of(lesson), layouts)
    found = []
    for doubt in _doubts(lesson, kinds):
        answers, shown = [(*doubt.answers[0], lesson)], [meanwhile]
        for value, corrections in doubt.answers[1:]:
            try:
                other = with_answer(lesson, corrections)
            except UserError:
                continue  # nothing can be learnt with it, so it is no answer
            if any(other.tree == known.tree for _, _, known in answers):
                continue
            does = rehearse(other.tree, task_of(other), layouts)
            if not any(_alike(does, known, lesson.task) for known in shown):
                answers.append((value, corrections, other))
                shown.append(does)
        if len(answers) > 1:
            states = _where_they_part(shown, lesson.task)
            found.append(
                Question(
                    doubt.kind,
                    doubt.subject,
                    tuple(Answer(*answer, state) for answer, state in zip(answers, states, strict=True)),
                )
            )
    return tuple(found)


def _where_they_part(shown: Sequence[Sequence[Rehearsal]], task: Task) -> list[World]:
    """Return for each answer the state after the first move in which it differs, in the layout in which they part most."""
    together = [*zip(*shown, strict=True)]  # for each layout what all answers do there
    pairs = [[*itertools.combinations(each, 2)] for each in together]
    apart = [
        (min(parting(one, other, task) for one, other in own), sum(each.ending == Ending.SUCCESS for each in all_of))
        for own, all_of in zip(pairs, together, strict=True)
    ]
    best = max(range(len(apart)), key=lambda k: apart[k])
    move = min(first_difference(one, other, task) for one, other in pairs[best])
    return [one.moves[move].after if move < len(one.moves) else one.final for one in together[best]]


def with_answer(lesson: Lesson, corrections: Corrections) -> Lesson:
    """Return what is learnt from the same demonstrations with more corrections. Raise UserError as `learn` does."""
    shown = lesson.demonstrations
    return learn(dataclasses.replace(shown, corrections=shown.corrections | corrections), lesson.task)


def answered(lesson: Lesson) -> tuple[Answered, ...]:
    """Return what a person has said about the demonstrations of a lesson."""
    said = lesson.demonstrations.corrections
    found: list[Answered] = []
    step_at = {instance: step for step, one in enumerate(lesson.inferences) for instance in one.instances}
    for step, one in enumerate(lesson.inferences):
        frames = {instance: said.frames[instance] for instance in one.instances if instance in said.frames}
        turns = {instance: said.turns[instance] for instance in one.instances if instance in said.turns}
        if frames:
            found.append(Answered("frame", (step,), one.frame, Corrections(frames=frames)))
        if turns and not one.slot:
            found.append(Answered("turn", (step,), one.turn, Corrections(turns=turns)))
    goals = {condition for one in lesson.subtasks for condition in one.subtask.goal}
    orders: dict[tuple[int, ...], dict[tuple[Instance, Instance], bool]] = {}
    for (before, after), meant in said.orders.items():
        step = step_at[before]
        subject: tuple[int, ...] = (step, step_at[after]) if _end_of(lesson.inferences[step]) in goals else (step,)
        orders.setdefault(subject, {})[before, after] = meant
    for subject, pairs in orders.items():
        kind: QuestionKind = "order" if len(subject) > 1 else "step"
        found.append(Answered(kind, subject, all(pairs.values()), Corrections(orders=pairs)))
    for name, meant in said.itself.items():
        if name not in lesson.task.object_names:
            continue
        part = lesson.task.thing(name).part
        found.append(Answered("instance", (), name if meant else part, Corrections(itself={name: meant})))
    return tuple(found)


def task_of(lesson: Lesson) -> Task:
    """Return the task of a lesson with the demonstrated places as its targets, where these are one for each object."""
    try:
        return dataclasses.replace(lesson.task, targets=lesson.targets)
    except UserError:
        return lesson.task


def _alike(some: Sequence[Rehearsal], others: Sequence[Rehearsal], task: Task) -> bool:
    return all(parting(one, other, task) <= 1 for one, other in zip(some, others, strict=True))


def _doubts(lesson: Lesson, kinds: Collection[QuestionKind]) -> Iterator[_Doubt]:
    """Yield what may be asked of a lesson."""
    for step, one in enumerate(lesson.inferences):
        if one.kind == "place":
            if "frame" in kinds:
                yield from _frames(lesson, step, one)
            if "turn" in kinds:
                yield from _turns(lesson, step, one)
    if "step" in kinds or "order" in kinds:
        for subtask in lesson.subtasks:
            yield from (doubt for doubt in _orders(lesson, subtask) if doubt.kind in kinds)
    if "instance" in kinds:
        yield from _instances(lesson)


def _frames(lesson: Lesson, step: int, place: Inference) -> Iterator[_Doubt]:
    """Yield the frames that the demonstrations cannot tell from each other."""
    said = lesson.demonstrations.corrections.frames
    if place.tied and not any(instance in said for instance in place.instances):
        frames = (place.frame, *sorted(place.tied, key=lambda frame: _rank(frame, lesson.task)))
        answers = [(frame, Corrections(frames=dict.fromkeys(place.instances, frame))) for frame in frames]
        yield _Doubt("frame", (step,), tuple(answers))


def _turns(lesson: Lesson, step: int, place: Inference) -> Iterator[_Doubt]:
    """Yield the turn of which it is in doubt whether it is meant."""
    said = lesson.demonstrations.corrections.turns
    if place.slot or any(instance in said for instance in place.instances):
        return
    rows = [row for row in observe(lesson.demonstrations, lesson.task) if row.instance in place.instances]
    turn = doubtful_turn(rows, place.frame, lesson.task.thing(place.object))
    if turn is not None:
        turns = (place.turn, None if place.turn is not None else turn.degrees)
        answers = [(value, Corrections(turns=dict.fromkeys(place.instances, value))) for value in turns]
        yield _Doubt("turn", (step,), tuple(answers))


def _rank(frame: str, task: Task) -> int:
    """Return how late a frame is named: objects, then kits, then the robot's."""
    return 2 if frame == task.robot_frame else 1 if frame in task.kit_names else 0


def _orders(lesson: Lesson, subtask: LearntSubtask) -> Iterator[_Doubt]:
    """Yield the orders of placements that few demonstrations show and that something waits for. A step on the way, whose end
    is not in the goal, is asked for once: whether it is meant at all."""
    inferences = lesson.inferences
    followers: dict[int, list[int]] = {}
    for order in subtask.constraints:
        kinds = {inferences[step].kind for step in (order.before, order.after)}
        if kinds == {"place"} and order.seen < SURE:
            followers.setdefault(order.before, []).append(order.after)
    for before, later in followers.items():
        end = _end_of(inferences[before])
        direct = [after for after in later if not any(after in followers.get(other, ()) for other in later)]
        waits = [after for after in direct if end in _waits_for(inferences[after], subtask)]
        on_the_way = end not in subtask.subtask.goal
        for afters in [later] if on_the_way and waits else [] if on_the_way else [[after] for after in waits]:
            pairs = [pair for after in afters for pair in _pairs(inferences[before], inferences[after])]
            if any(pair in lesson.demonstrations.corrections.orders for pair in pairs):
                continue
            answers = [(meant, Corrections(orders=dict.fromkeys(pairs, meant))) for meant in (True, False)]
            yield _Doubt("step" if on_the_way else "order", (before, *([] if on_the_way else afters)), tuple(answers))


def _waits_for(place: Inference, subtask: LearntSubtask) -> set[Behavior]:
    """Return what a placement, or the pick before it, waits for besides its own preconditions."""
    actions = place.behavior, Behavior("pick", (place.object,))
    return {condition for action in actions for condition in subtask.preconditions.get(action, ())}


def _end_of(inference: Inference) -> Behavior:
    return Behavior("at", inference.behavior.args)


def _pairs(before: Inference, after: Inference) -> list[tuple[Instance, Instance]]:
    """Return the actions of two inferences that follow each other in a demonstration."""
    return [
        (one, other)
        for one in before.instances
        for other in after.instances
        if one.demonstration == other.demonstration and one.index < other.index
    ]


def _instances(lesson: Lesson) -> Iterator[_Doubt]:
    """Yield the instances of parts that every demonstration takes for the same place, though there are others."""
    task, shown = lesson.task, lesson.demonstrations
    rows = {one.instance: one for one in observe(shown, task)}
    for step, one in enumerate(lesson.inferences):
        others = task.instances.get(one.object, ())
        names = {rows[instance].thing for instance in one.instances}
        if one.kind != "place" or len(names) > 1 or len(others) < 2 or one.object in task.object_names:
            continue
        (name,) = names
        elsewhere = [row for row in rows.values() if row.thing == name and row.instance not in one.instances]
        moved_elsewhere = any(row.action.kind == "place" for row in elsewhere)
        if name in shown.corrections.itself or len(one.instances) < NEEDED or moved_elsewhere:
            continue
        answers = [(one.object, Corrections(itself={name: False})), (name, Corrections(itself={name: True}))]
        yield _Doubt("instance", (step,), tuple(answers))
