"""What went wrong in a tick, in sentences for people."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from bt_jax.behaviors import Behavior
from bt_jax.mjx_env.faults.events import is_away
from bt_jax.mjx_env.skills import Mishaps
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["between_words", "command_words"]


def command_words(task: Task, before: World, command: Behavior, mishaps: Mishaps) -> str:
    """Return what goes wrong as a command is carried out in a state, both batches of one, or an empty text.

    "YellowBox drops on the way"
    """
    held = int(before.held[0])
    name = task.object_names[held] if held >= 0 else str(command.object)
    if mishaps.jams[0]:
        opens = command.name in ("open_gripper", "place")
        return f"the gripper does not {'open' if opens else 'close'}"
    if mishaps.slips[0]:
        return f"{name} slips out of the gripper"
    if mishaps.share[0] < 1:
        return f"{name} drops on the way"
    x, y, turn = mishaps.error[0].tolist()
    if not (x or y or turn):
        return ""
    turned = f" and turned by {abs(math.degrees(turn)):.1f} degrees" if turn else ""
    return f"{name} is put down {1000 * math.hypot(x, y):.1f} mm off{turned}"


def between_words(task: Task, before: World, after: World) -> Iterator[str]:
    """Yield what has happened between two ticks, from the states at its begin and its end, batches of one.

    "a person moves GreenBox"
    """
    assert before.unseen is not None
    assert after.unseen is not None
    was_away, away = is_away(before, task)[0], is_away(after, task)[0]
    moved = (before.poses[0] != after.poses[0]).any(axis=-1)
    hidden, seen = after.unseen[0] & ~before.unseen[0], before.unseen[0] & ~after.unseen[0]
    for i in np.flatnonzero(moved).tolist():
        name = task.object_names[i]
        if away[i]:
            yield f"a person takes {name} away"
        else:
            yield f"a person brings {name} back" if was_away[i] else f"a person moves {name}"
    for i in np.flatnonzero(hidden & ~away).tolist():
        yield f"{task.object_names[i]} gets out of sight"
    for i in np.flatnonzero(seen & ~was_away).tolist():
        yield f"{task.object_names[i]} is in sight again"
