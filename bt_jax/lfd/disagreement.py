"""Which demonstrations put something elsewhere than most of the others do."""

from __future__ import annotations

import dataclasses
import math

from bt_jax.lfd.clustering import NEEDED
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson

__all__ = ["Disagreement", "agreed_place", "disagreements"]


@dataclasses.dataclass(frozen=True)
class Disagreement:
    """The demonstration `name` puts an object `away` [m] from where `agreeing` others put it, in the frame in which those
    agree."""

    name: str
    object: str
    frame: str
    away: float
    agreeing: int


def agreed_place(lesson: Lesson, thing: str) -> Inference | None:
    """Return the place on which most of the demonstrations that move an object agree, the first if there are several; None
    if there is none."""
    places = [one for one in lesson.inferences if one.kind == "place" and one.object == thing]
    moving = {instance.demonstration for one in places for instance in one.instances}
    shared = [one for one in places if len(_of(one)) >= max(NEEDED, len(moving) // 2 + 1)]
    return max(shared, key=lambda one: len(_of(one)), default=None)


def disagreements(lesson: Lesson) -> tuple[Disagreement, ...]:
    """Return what does not belong to the clusters that most of the demonstrations form: places that so few share that they
    are no cluster, in demonstrations without the place that is agreed on."""
    found = []
    for one in lesson.inferences:
        agreed = agreed_place(lesson, one.object) if one.kind == "place" and len(_of(one)) < NEEDED else None
        if agreed is None:
            continue
        for instance in one.instances:
            if instance.demonstration in _of(agreed):
                continue
            demonstration = lesson.demonstrations.demonstrations[instance.demonstration]
            away = math.dist(demonstration.actions[instance.index].handled(agreed.frame), agreed.position)
            found.append(Disagreement(demonstration.name, one.object, agreed.frame, away, len(_of(agreed))))
    return tuple(found)


def _of(inference: Inference) -> set[int]:
    """Return the demonstrations that an inference was drawn from."""
    return {instance.demonstration for instance in inference.instances}
