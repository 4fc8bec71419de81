"""What cannot work yet, in the words of the page."""

from __future__ import annotations

import functools
import re

from bt_jax.app.units import in_millimetres
from bt_jax.tasks import Problem, Task, problems

__all__ = ["complaints"]

# What the problems say in the words of a file, and how the page says it.
SPOKEN = (
    (
        r"there is nothing to do; add at least one target",
        "nothing has to be anywhere yet; drag something to where it should be",
    ),
    (r" or gripper_opening larger", ""),
    (r" or kit\.size larger", " or the tray larger"),
    (
        r"use fewer or smaller objects, lower layout\.spacing or layout\.margin, or add tables",
        "use fewer or smaller ones",
    ),
    (r"lower spacing or margin, or add tables", "use fewer of them"),
    (r"move it away from slots\[\d+\]", "move one of them"),
    (r"; move one of them, or name another table", "; move one of them, or put it on another table"),
    (r" of targets\[\d+\]", ""),
    (r"(\d+) ticks are too few", r"\1 steps are too few"),
    (r"write (\S+) for z, or another place", "put it elsewhere"),
)
METRES = re.compile(r"\b(\d*\.?\d+)( x )?(\d*\.?\d+)? m\b")


@functools.lru_cache(maxsize=8)
def complaints(task: Task) -> tuple[str, ...]:
    """Return why the task cannot be done yet, one sentence for each reason."""
    return tuple(dict.fromkeys(_said(task, problem) for problem in problems(task)))


def _said(task: Task, problem: Problem) -> str:
    text = str(problem)
    for pattern, words in SPOKEN:
        text = re.sub(pattern, words, text)
    text = METRES.sub(_millimetres, text)
    name = _name(task, problem.key)
    return f"{text[:1].upper()}{text[1:]}." if not name or name in text else f"{name}: {text}."


def _name(task: Task, key: str) -> str:
    """Return what a key belongs to, nothing if to the task as a whole."""
    found = re.match(r"(objects|kits|targets)\[(\d+)\]", key)
    if found is None:
        return ""
    number = int(found[2])
    if found[1] == "kits":
        return task.kit_names[number]
    return task.objects[number].name if found[1] == "objects" else task.targets[number].object


def _millimetres(found: re.Match[str]) -> str:
    both = [f"{in_millimetres(float(one)):g}" for one in (found[1], found[3]) if one]
    return f"{' x '.join(both)} mm"
