"""What the demonstrations leave open, as questions with their alternatives."""

from __future__ import annotations

import dataclasses

from bt_jax.lfd.inference import Inference
from bt_jax.tasks import Task

__all__ = ["Question", "question_of"]


@dataclasses.dataclass(frozen=True)
class Question:
    """What a place is relative to, where the demonstrations cannot tell.

    `action` is the index of the inference; `alternatives` are the frames, first the one that is taken meanwhile. `text`
    asks, and `settled_by` says what answers it besides choosing one of them, None if nothing else does.
    """

    action: int
    object: str
    alternatives: tuple[str, ...]
    text: str
    settled_by: str | None


def question_of(action: int, inference: Inference, task: Task) -> Question | None:
    """Return the question that an inference leaves open; None if there is none, or if a person has answered it."""
    if not inference.tied or inference.chosen:
        return None
    others = sorted(inference.tied, key=lambda frame: (frame == task.robot_frame, frame == task.kit.name))
    frames = (inference.frame, *others)
    moving = [frame for frame in frames if frame != task.robot_frame]
    followed = ", or ".join("its place in the kit" if frame == task.kit.name else frame for frame in moving)
    stays = ", or stay at a fixed place" if len(moving) < len(frames) else ""
    movable = [frame for frame in moving if frame != task.kit.name or task.layout.kit == "random"]
    other = None if not movable else "the kit" if movable[0] == task.kit.name else movable[0]
    return Question(
        action=action,
        object=inference.object,
        alternatives=frames,
        text=f"Should {inference.object} follow {followed}{stays}?",
        settled_by=None if other is None else f"show it once with {other} elsewhere",
    )
