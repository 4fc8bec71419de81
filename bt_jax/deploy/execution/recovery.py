"""How arms that a stop has left anywhere, perhaps with a box in the fingers, come home again."""

from __future__ import annotations

from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.movements import Movements, Routine
from bt_jax.deploy.planning.clearance import Carried

__all__ = ["between", "recovery"]


def between(moves: Movements, arm: str) -> str | None:
    """Return the box that an arm's fingers are as far apart as, None if they are as for none: what they may hold."""
    opening = moves.link.arm(arm).opening
    if not opening < moves.robot.arm(arm).gripper.opening - moves.grasp.nothing:
        return None
    fits = [name for name, size in moves.sizes.items() if abs(opening - size) <= moves.grasp.fit]
    return min(fits, key=lambda name: abs(opening - moves.sizes[name]), default=None)


def recovery(moves: Movements, *, keep: bool) -> Routine:
    """Open the fingers, or `keep` what they hold; rise straight up from whatever is near, and go home. Raise Failed or
    Unplannable if that cannot be."""
    for arm in moves.link.arms:
        held = between(moves, arm)
        if not keep:
            moves.carried.pop(arm, None)
            moves.link.grip(arm, moves.robot.arm(arm).gripper.opening, moves.grasp.force)
            yield from moves.fingers(arm)
        elif held is not None and arm not in moves.carried:
            moves.carried[arm] = Carried(arm, held, RigidTransform.identity())
    for arm in moves.link.arms:
        line = yield from moves.planned(moves.planner.lift, arm, moves.surroundings(arm))
        if line is not None:
            yield from moves.straight(arm, line)
    yield from moves.go_home(moves.link.arms)
