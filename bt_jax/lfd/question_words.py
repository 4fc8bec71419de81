"""Questions about demonstrations, and their answers, in plain words."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson
from bt_jax.lfd.questions import Answered, Question, QuestionKind, Value
from bt_jax.mjx_env.world import World, poses_by_name
from bt_jax.tasks import Task

__all__ = ["answer_words", "answered_words", "question_words", "start_words"]

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def question_words(question: Question, lesson: Lesson) -> str:
    """Return a question of a lesson as a sentence."""
    task, about = lesson.task, [lesson.inferences[step] for step in question.subject]
    first = about[0]
    match question.kind:
        case "frame":
            frames = [str(answer.value) for answer in question.answers]
            follows = [_followed(frame, task) for frame in frames if frame != task.robot_frame]
            if len(follows) < len(frames):
                return f"Should {_named(first, task)} follow {_or(follows)}, or stay at a fixed place?"
            return f"Should {_named(first, task)} follow {_or(follows)}?"
        case "turn":
            turn = next(answer.value for answer in question.answers if answer.value is not None)
            return f"Should {_named(first, task)} lie turned by {turn:g} degrees, or does its turn not matter?"
        case "step":
            return f"Is it meant that {_named(first, task)} is put {_place(first, task)} first?"
        case "order":
            return f"Is {_named(first, task)} before {_named(about[1], task)} meant?"
    part, name = (str(answer.value) for answer in question.answers)
    count = len(task.instances[part])
    many = NUMBERS[count] if count < len(NUMBERS) else str(count)
    return f"There are {many} equal {part}s: {name} and no other, or any?"


def answer_words(kind: QuestionKind, value: Value, lesson: Lesson) -> str:
    """Return an answer as a few words."""
    task = lesson.task
    match kind:
        case "frame":
            stays = value == task.robot_frame
            return "Stay at a fixed place" if stays else f"Follow {_followed(str(value), task)}"
        case "turn":
            return "Any turn will do" if value is None else f"Turned by {value:g} degrees"
        case "step":
            return "Yes, do that first" if value else "No, leave it out"
        case "order":
            return "Yes, in this order" if value else "No, any order will do"
    return f"Any {value} will do" if value not in task.object_names else f"{value} and no other"


def answered_words(said: Answered, lesson: Lesson) -> str:
    """Return what a person has answered as a sentence."""
    task, about, value = lesson.task, [lesson.inferences[step] for step in said.subject], said.value
    match said.kind:
        case "frame":
            stays = value == task.robot_frame
            where = "stays at a fixed place" if stays else f"follows {_followed(str(value), task)}"
            return f"{_named(about[0], task)} {where}."
        case "turn":
            lies = "may be turned in any way" if value is None else f"lies turned by {value:g} degrees"
            return f"{_named(about[0], task)} {lies}."
        case "step":
            put = f"{_named(about[0], task)} is put {_place(about[0], task)} first"
            return f"That {put} is {'meant' if value else 'not necessary'}."
        case "order":
            names = f"{_named(about[0], task)} before {_named(about[1], task)}"
            return f"{names} is {'meant' if value else 'not necessary'}."
    return f"Any {value} will do." if value not in task.object_names else f"It has to be {value}."


def start_words(start: World, task: Task) -> str:
    """Return on which table everything starts, as a sentence."""
    on: dict[str, list[str]] = {}
    poses = poses_by_name(start, task)
    for name in (*task.kit_names, *task.object_names):
        here = poses[name].position[:2]
        table = min((math.dist(one.position[:2], here), one.name) for one in task.tables)[1]
        on.setdefault(table, []).append(_kit(name, task) if name in task.kit_names else name)
    parts = [f"{_and(names)} on {table}" for table, names in on.items()]
    return f"Start with {_and(parts)}."


def _named(inference: Inference, task: Task) -> str:
    part = inference.object not in task.object_names
    return f"the {inference.object}" if part else inference.object


def _place(inference: Inference, task: Task) -> str:
    """Return roughly where an object is put down."""
    if inference.slot:
        return f"into {inference.slot}"
    if inference.frame == task.robot_frame:
        return "on a table"
    return f"in {_kit(inference.frame, task)}" if inference.frame in task.kit_names else f"beside {inference.frame}"


def _followed(frame: str, task: Task) -> str:
    return f"its place in {_kit(frame, task)}" if frame in task.kit_names else frame


def _kit(name: str, task: Task) -> str:
    return "the kit" if len(task.kits) == 1 else name


def _or(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def _and(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
