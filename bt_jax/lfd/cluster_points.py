"""Where the demonstrations put an object and how they turned it, as points to be drawn. Importing this brings no plotting
library, which takes long."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson

__all__ = ["LEAST", "cluster_points", "cluster_turns"]

LEAST = 0.01  # metres to each side of the mean that a drawing shows at least


def cluster_points(lesson: Lesson, inference: Inference, frame: str) -> tuple[np.ndarray, np.ndarray]:
    """Return where the object was in the instances of an action, and in those of other actions of its kind, in a frame:
    two arrays [n, 3], metres."""
    demonstrations = lesson.demonstrations.demonstrations
    same = [one for one in lesson.inferences if one.kind == inference.kind and one.object == inference.object]

    def positions(inferences: Sequence[Inference]) -> np.ndarray:
        instances = [instance for one in inferences for instance in one.instances]
        points = [demonstrations[m.demonstration].actions[m.index].handled(frame) for m in instances]
        return np.array(points).reshape(-1, 3)

    return positions([inference]), positions([one for one in same if one is not inference])


def cluster_turns(lesson: Lesson, inference: Inference) -> np.ndarray:
    """Return how the object was turned in the frame of a placement in each of its instances, degrees, [n]."""
    frames, shown = lesson.demonstrations.frames, lesson.demonstrations.demonstrations
    things = [shown[m.demonstration].things(frames)[m.index] for m in inference.instances]
    actions = [shown[m.demonstration].actions[m.index] for m in inference.instances]
    return np.array([one.turn(thing, inference.frame) for one, thing in zip(actions, things, strict=True)])
