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
    """Return the question that an inference leaves open; None if there is none, or if a person has answered it. Of several
    kits at fixed places, none is asked for: it makes no difference."""
    if not inference.tied or inference.chosen:
        return None
    called = {kit: "the kit" if len(task.kits) == 1 else kit for kit in task.kit_names}
    others = sorted(inference.tied, key=lambda frame: (frame == task.robot_frame, frame in called))
    if inference.frame in called:  # it is in this kit, so it hardly follows another
        others = [frame for frame in others if frame not in called]
    frames = (inference.frame, *others)
    moving = [frame for frame in frames if frame != task.robot_frame]
    followed = ", or ".join(f"its place in {called[frame]}" if frame in called else frame for frame in moving)
    stays = ", or stay at a fixed place" if len(moving) < len(frames) else ""
    still = [kit.name for kit in task.kits if kit.table or task.layout.kit != "random"]
    movable = [frame for frame in moving if frame not in still]
    other = called.get(movable[0], movable[0]) if movable else None
    if len(frames) == 1 or (other is None and len(task.kits) > 1):
        return None
    return Question(
        action=action,
        object=inference.object,
        alternatives=frames,
        text=f"Should {inference.object} follow {followed}{stays}?",
        settled_by=None if other is None else f"show it once with {other} elsewhere",
    )
