"""How arms that a stop has left anywhere, perhaps with a box in the fingers, come home again."""

from __future__ import annotations

from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.movements import Failed, Movements, Routine
from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.grasps import carried_pose
from bt_jax.deploy.planning.pose_geometry import distance_between

__all__ = ["between", "recovery"]


def between(moves: Movements, arm: str) -> Carried | None:
    """Return what an arm's fingers may hold, None if they are open or closed: the box that is seen between them, else
    something as large as the smallest box that would hold them as far apart."""
    opening, grasp = moves.link.arm(arm).opening, moves.grasp
    if not grasp.nothing < opening < moves.robot.arm(arm).gripper.opening - grasp.nothing:
        return None
    tcp = moves.robot.forward(arm, moves.link.arm(arm).commanded)
    for name, thing in moves.things.items():
        if name in moves.seen.poses:
            carried = Carried(arm, name, carried_pose(tcp, moves.seen.poses[name], thing))
            near = distance_between(tcp, moves.seen.poses[name]) <= thing.edge / 2 + grasp.near
            if near and abs(opening - moves.width(carried)) <= grasp.fit:
                return carried
    sizes = sorted(moves.things, key=lambda name: moves.things[name].edge)
    fitting = next((name for name in sizes if opening <= moves.things[name].edge + grasp.fit), sizes[-1])
    return Carried(arm, fitting, RigidTransform.identity(), known=False)


def recovery(moves: Movements, *, keep: bool) -> Routine:
    """Open the fingers, or `keep` what they hold; rise straight up from whatever is near, and go home. Raise Failed or
    Unplannable if that cannot be."""
    if keep:
        found = {arm: between(moves, arm) for arm in moves.link.arms}
        moves.carried = {arm: carried for arm, carried in found.items() if carried is not None}
        if len(moves.carried) > 1:
            raise Failed(
                f"the fingers of the {' and '.join(moves.carried)} arms are neither open nor closed, and one box at most is "
                'taken along; take what one of them holds out by hand, or choose "release"'
            )
    else:
        yield from _let_go(moves)
    for arm in moves.link.arms:
        line = yield from moves.planned(moves.planner.lift, arm, moves.all_around())
        if line is not None:
            yield from moves.straight(arm, line)
    yield from moves.go_home(moves.link.arms)


def _let_go(moves: Movements) -> Routine:
    """Open all fingers. Raise Failed if they do not open."""
    moves.carried.clear()
    widest = {arm: moves.robot.arm(arm).gripper.opening for arm in moves.link.arms}
    for arm, opening in widest.items():
        moves.link.grip(arm, opening, moves.grasp.force)
    for arm, opening in widest.items():
        yield from moves.fingers(arm, at_least=0.95 * opening)
