"""Which conditions cannot hold together, which hold anyway, and which actions undo a condition.

`parts` are names that stand for any of several interchangeable objects: one instance may be held or elsewhere while another
is at a place, and a pick leaves those alone that are where they should be.
"""

from __future__ import annotations

from collections.abc import Collection

from bt_jax.behaviors import NOTHING, OPEN, Behavior

__all__ = ["conflict", "implies", "undoes"]


def conflict(a: Behavior, b: Behavior, *, parts: Collection[str] = ()) -> bool:
    """Return whether two conditions exclude each other: different things held, two states of the gripper, one object at two
    places, something held by an open gripper, or something held that is at a place: `at` is false while the object hangs
    in the gripper."""
    if a.name == b.name:
        match a.name:
            case "holding" | "gripper":
                return a.args != b.args
            case "at":
                return a.object == b.object and a != b and a.object not in parts
    held = next((c.object for c in (a, b) if c.name == "holding"), NOTHING)
    opened = any(c.name == "gripper" and c.args == (OPEN,) for c in (a, b))
    placed = held not in parts and any(c.name == "at" and c.object == held for c in (a, b))
    return held != NOTHING and (opened or placed)


def implies(a: Behavior, b: Behavior) -> bool:
    """Return whether a condition includes another: an open gripper holds nothing."""
    return a == b or (a == Behavior("gripper", (OPEN,)) and b == Behavior("holding", (NOTHING,)))


def undoes(action: Behavior, condition: Behavior, *, parts: Collection[str] = ()) -> bool:
    """Return whether carrying out an action makes a condition false, or may: it moves the object that the condition is
    about, or the object in whose frame that one stands, it drives to something else than what is to be within reach, or its
    postconditions exclude the condition."""
    if condition.name == "reachable" and action.name == "approach":
        return action.args != condition.args
    if condition.name == "at" and action.name in ("pick", "place"):
        return action.object == condition.frame or (
            action.object == condition.object and action.object not in parts and condition not in action.postconditions
        )
    return any(conflict(post, condition, parts=parts) for post in action.postconditions)
