"""Places as conditions of trees and as targets of tasks."""

from __future__ import annotations

from bt_jax.behaviors import Behavior
from bt_jax.tasks import Target

__all__ = ["condition_of", "target_of"]


def condition_of(target: Target) -> Behavior:
    """Return that an object is at a place, and turned as it says."""
    turned = () if target.turn is None else (target.turn,)
    return Behavior("at", (target.object, target.position, target.frame, *turned))


def target_of(placement: Behavior) -> Target:
    """Return the place of an `at`, a `place` or a `move`."""
    thing, position, frame = placement.object, placement.position, placement.frame
    if thing is None or position is None or frame is None:
        raise ValueError(f"{placement} is not a placement")
    return Target(thing, position, frame, placement.turn)
