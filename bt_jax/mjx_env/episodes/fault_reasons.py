"""Why an episode did not solve its task where things go wrong: a fault after which the tree does nothing right."""

from __future__ import annotations

import math

import numpy as np

from bt_jax.mjx_env.episodes.playback import Playback, Tick
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.faults.events import is_away
from bt_jax.mjx_env.predicates import is_seen
from bt_jax.tasks import Task

__all__ = ["why_mishap", "why_moved", "why_unknown"]


def why_unknown(task: Task, playback: Playback) -> str:
    """Return which object nobody sees as the tree fails, or that a person has one to the end; an empty text if neither is
    so."""
    last = playback.ticks[-1].before if playback.ending == Ending.FAILURE else playback.final
    if last.unseen is None:
        return ""
    away = _names(task, is_away(last, task)[0])
    if away and playback.ending == Ending.FAILURE:
        return f"the tree fails while a person has {away[0]}"
    if away:
        return f"a person has {away[0]} at the end"
    hidden = _names(task, ~is_seen(last)[0])
    return f"the tree fails while {hidden[0]} is out of sight" if hidden and playback.ending == Ending.FAILURE else ""


def why_mishap(task: Task, tick: Tick, name: str) -> str:
    """Return what went wrong with the last `place` of an object that did not arrive, or an empty text."""
    if tick.mishaps is None:
        return ""
    if tick.mishaps.jams[0]:
        return f"the gripper does not let go of {name}, and that is not tried again"
    if tick.mishaps.share[0] < 1:
        return f"{name} drops on the way and is not put there again"
    if math.hypot(*tick.mishaps.error[0, :2].tolist()) >= task.episode.tolerance:
        return f"{name} is put down too far off and stays there"
    return ""


def why_moved(playback: Playback, put: Tick, name: str) -> str:
    """Return that a person has moved an object since it was put where it should be, or an empty text."""
    first = next(i for i, tick in enumerate(playback.ticks) if tick is put)
    moved = any(f"a person moves {name}" in tick.troubles for tick in playback.ticks[first:])
    return f"a person moves {name}, and nothing puts it back" if moved else ""


def _names(task: Task, chosen: np.ndarray) -> list[str]:
    return [task.object_names[i] for i in np.flatnonzero(chosen).tolist()]
