"""What several demonstrations have put where, laid over each other in one scene."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection

import numpy as np

from bt_jax.app.state.extents import Pose, heading, in_world, turned
from bt_jax.lfd import Lesson
from bt_jax.lfd.disagreement import agreed_place, disagreements
from bt_jax.mjx_env.world import World, frames

__all__ = ["Overlaid", "overlaid"]


@dataclasses.dataclass(frozen=True, eq=False)
class Overlaid:
    """Where a demonstration would put an object in the scene; it `disagrees` if most of the others put it elsewhere."""

    demonstration: str
    thing: str
    pose: Pose
    disagrees: bool


def overlaid(lesson: Lesson, world: World, names: Collection[str]) -> list[Overlaid]:
    """Return where the demonstrations of these names would put their objects in `world`, a batch of one (NumPy): relative to
    what the place is inferred to be relative to, once that is where it is put itself."""
    task = lesson.task
    ended = dict(zip(task.frames, np.asarray(frames(world, task)[0], float), strict=True))
    odd = {(one.name, one.object) for one in disagreements(lesson)}
    found = []
    for one in lesson.inferences:
        if one.kind != "place":
            continue
        agreed = agreed_place(lesson, one.object) or one
        frame = ended[agreed.frame]
        for instance in one.instances:
            shown = lesson.demonstrations.demonstrations[instance.demonstration]
            action, thing = shown.actions[instance.index], shown.things(lesson.demonstrations.frames)[instance.index]
            turn = action.turn(thing, agreed.frame) if thing in action.poses else math.nan
            pose = turned(
                in_world(frame, np.array(action.handled(agreed.frame))),
                heading(frame) + (0.0 if math.isnan(turn) else turn),
            )
            if shown.name in names:
                found.append(Overlaid(shown.name, thing, pose, (shown.name, one.object) in odd))
        if one is agreed and one.object in ended:
            ended[one.object] = turned(in_world(frame, np.array(one.position)), heading(frame) + (one.turn or 0.0))
    return found
