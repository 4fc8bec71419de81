"""A lesson in words: what was inferred, and from what."""

from __future__ import annotations

import math
from collections.abc import Callable

from bt_jax.behaviors import Behavior
from bt_jax.lfd.clustering import NEEDED
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import LearntSubtask, Lesson

__all__ = ["action_rows", "goal_sentence", "missing_sentence", "order_sentences", "precondition_sentences"]


def action_rows(lesson: Lesson) -> list[dict[str, str]]:
    """Return one row for each distinct action: `what` was inferred, in how many demonstrations it was `seen`, and `why`
    this frame: what agrees there, its score, and the runner-up's."""
    return [
        {
            "what": _what(inference),
            "seen": f"in {len({one.demonstration for one in inference.instances})} of {len(lesson.demonstrations)}",
            "why": _why(inference),
        }
        for inference in lesson.inferences
    ]


def missing_sentence(lesson: Lesson) -> str:
    """Return how many demonstrations are there and needed, said plainly; empty if they suffice."""
    if not lesson.missing:
        return ""
    return (
        f"{len(lesson.demonstrations)} of {NEEDED} demonstrations needed: from {NEEDED} on, the frames of the places "
        f"are inferred; until then all but slots are fixed places in {lesson.demonstrations.frames.default}"
    )


def order_sentences(lesson: Lesson, one: LearntSubtask, *, say: Callable[[Behavior], str] = str) -> list[str]:
    """Return which placement comes before which other, and in how many demonstrations that was seen. What follows from the
    others is left out. `say` names an action."""
    places = {step for step, inference in enumerate(lesson.inferences) if inference.kind == "place"}
    pairs = {(order.before, order.after) for order in one.constraints}
    found = []
    for order in one.constraints:
        follows = any((order.before, step) in pairs and (step, order.after) in pairs for step in places)
        if order.before in places and order.after in places and not follows:
            before, after = (say(lesson.inferences[step].behavior) for step in (order.before, order.after))
            seen = f"all {order.seen} demonstrations that have" if order.seen > 1 else "the one demonstration that has"
            found.append(f"{before} before {after}: in {seen} both")
    return found


def precondition_sentences(one: LearntSubtask, *, say: Callable[[Behavior], str] = str) -> list[str]:
    """Return what an action waits for besides its own preconditions, but not what those places wait for themselves. `say`
    names actions and conditions."""
    found = []
    for action, conditions in one.preconditions.items():
        earlier = {it for place in conditions for it in one.preconditions.get(Behavior("place", place.args), ())}
        own = [condition for condition in conditions if condition not in earlier]
        if own and action.name == "place":
            found.append(f"{say(action)} waits for {', '.join(map(say, own))}")
    return found


def goal_sentence(goal: tuple[Behavior, ...]) -> str:
    """Return a goal on one line."""
    return " and ".join(map(str, goal))


def _what(inference: Inference) -> str:
    if inference.kind == "pick":
        return f"pick {inference.object}"
    x, y, z = inference.position
    where = f"at ({x:g}, {y:g}, {z:g}) in {inference.frame}"
    if inference.slot:
        where = f"in the slot {inference.slot}"
    turned = "" if inference.turn is None else f", turned by {inference.turn:g} degrees"
    return f"place {inference.object} {where}{turned}, within {1000 * inference.tolerance:.0f} mm"


def _why(inference: Inference) -> str:
    note = f"; {inference.note}" if inference.note else ""
    if inference.kind == "pick" or not inference.candidates:
        return inference.reason + note
    scores = [
        f"{candidate.frame} {candidate.score:.0f}" if candidate.score > -math.inf else f"{candidate.frame} none"
        for candidate in inference.candidates
    ]
    return f"{inference.reason}{note} (scores: {', '.join(scores)})"
