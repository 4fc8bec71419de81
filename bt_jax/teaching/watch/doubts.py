"""What is in doubt about the moves of a demonstration, each in a sentence."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from bt_jax.deploy.planning.pose_geometry import distance_between, turn_between
from bt_jax.teaching.watch.moves import Decision, Doubt, Move

__all__ = ["doubt_about_end", "doubts_about"]


def doubts_about(moves: Sequence[Move], slack: float) -> Iterator[Doubt]:
    """Yield what is in doubt about the last of the moves. Two overlap if the later one was seen away less than `slack` [s]
    after the other came to rest."""
    last, index = moves[-1], len(moves) - 1
    if last.kind == "bumped":
        millimetres = 1000 * distance_between(last.before.pose, last.after.pose)
        degrees = math.degrees(turn_between(last.before.pose, last.after.pose))
        how = f"by {millimetres:.0f} mm and {degrees:.0f} degrees"
        yield Doubt("bumped", f"{last.box} was bumped, {how}", (index,), "leave out")
    if last.kind != "carried":
        return
    for i, earlier in enumerate(moves[:-1]):
        if earlier.kind != "carried":
            continue
        if earlier.box == last.box:
            others = any(move.kind == "carried" for move in moves[i + 1 : -1])
            usual: Decision = "keep" if others else "leave out"
            yield Doubt("twice", f"{last.box} was moved twice", (i, index), usual)
        elif last.left < earlier.came + slack:
            yield Doubt("together", f"{earlier.box} and {last.box} were moved at once", (i, index), "keep")


def doubt_about_end(name: str, away: bool, *, visible: bool) -> Doubt:
    """Return what is in doubt about a body that is not at rest in sight at the end."""
    if visible:
        return Doubt("lost", f"{name} is not at rest at the end", (), "leave out")
    left = "has left the view" if away else "is out of sight at the end"
    return Doubt("lost", f"{name} {left}", (), "leave out")
