"""What "at", "rests on", "clear", "reachable" and "graspable" mean, and which instance of a part is meant, one object at a
time.

This is the reference, in plain Python. The simulation computes the same for batches of states (`mjx_env.predicates`) with
the constants of `GEOMETRY`, and a test compares both; the robot, the page and the demonstrations call these functions.
Lengths are metres, z points up, and all poses are in one frame. `poses` holds those of the objects, the kits and the robot's
frame, by name; what is not in it is not there. Where the robot drives, its frame stays where it starts, and `poses[BASE]` is
where it is now.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping

from bt_jax.behaviors.pose import Pose
from bt_jax.tasks.footprints import Footprint, overlap
from bt_jax.tasks.task import Episode, Target, Task
from bt_jax.tasks.things import Object, Vec2, Vec3

__all__ = [
    "BASE",
    "GEOMETRY",
    "Geometry",
    "Poses",
    "can_be_taken",
    "extents",
    "fingers_meet",
    "footprint",
    "heading",
    "in_own_target",
    "is_at",
    "is_clear",
    "is_graspable",
    "is_in_reach",
    "is_loose",
    "is_off_floor",
    "is_reachable",
    "is_upright",
    "is_within_reach",
    "rests_on",
    "standing_extents",
    "taken_by",
    "turn_error",
]

Poses = Mapping[str, Pose]
BASE = "robot/base"  # no name of a task has a slash

UNITS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Shares of sizes by which geometric conditions are decided.

    Centres of a tilted cube are up to sqrt(3) apart; `above_least` to `above_most` of the lower height covers what lies on
    top and not what lies beside.
    """

    above_least: float = 0.6  # of the lower of two heights: the least height of one bottom over the other
    above_most: float = 1.3  # and the largest
    upright: float = 0.97  # cosine of the inclination up to which an object counts as upright: 14 degrees
    steep: float = 0.7  # sine of the inclination from which an axis says nothing about the heading
    seated: float = (
        0.1  # of its height: how far below the lowest table's top an object may be, and still be within reach
    )


GEOMETRY = Geometry()


def extents(thing: Object, pose: Pose) -> Vec3:
    """Return half the extents of an object along the axes of the frame that its pose is given in."""
    w, x, y, z = pose.quaternion
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    u, v, h = (edge / 2 for edge in thing.size)
    if thing.shape == "cylinder":
        a, b, c = (math.sqrt(max(0.0, 1 - row[2] ** 2)) * u + abs(row[2]) * h for row in rows)
    else:
        a, b, c = (abs(row[0]) * u + abs(row[1]) * v + abs(row[2]) * h for row in rows)
    return a, b, c


def standing_extents(thing: Object, pose: Pose) -> Vec3:
    """Return half the extents by which an object stands on others: those of a cube are half its edge however it lies."""
    return (thing.edge / 2,) * 3 if thing.is_cube else extents(thing, pose)


def is_upright(thing: Object, pose: Pose) -> bool:
    """Does an object stand on its foot or, a cuboid, on the opposite face? A cube may stand on any."""
    _, x, y, _ = pose.quaternion
    return thing.is_cube or abs(1 - 2 * (x * x + y * y)) > GEOMETRY.upright


def heading(pose: Pose) -> float:
    """Return the angle about the vertical, radians, of the own x axis, or of the y axis less a right angle where the x axis
    is steep."""
    w, x, y, z = pose.quaternion
    if abs(2 * (x * z - w * y)) > GEOMETRY.steep:
        return math.atan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z))
    return math.atan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


def turn_error(thing: Object, pose: Pose, frame: Pose, turn: float) -> float:
    """Return by how much, radians, an object is turned about the vertical too far from `turn` degrees in a frame, to the
    nearest of the turns in which it looks alike."""
    period = math.radians(thing.symmetry)
    off = heading(pose) - heading(frame) - math.radians(turn)
    return off - period * round(off / period) if period else 0.0


def is_at(
    thing: Object, pose: Pose, frame: Pose, position: Vec3, *, turn: float | None = None, episode: Episode
) -> bool:
    """Does an object stand upright at a position in a frame, turned by `turn` degrees if that is given, within the
    tolerances of the episode?"""
    near = _distance(pose, frame, position) < episode.tolerance and is_upright(thing, pose)
    if turn is None or not near:
        return near
    return abs(turn_error(thing, pose, frame, turn)) < math.radians(episode.turn_tolerance)


def rests_on(
    upper: Object, upper_pose: Pose, lower: Object, lower_pose: Pose, *, above_most: float = GEOMETRY.above_most
) -> bool:
    """Does an object stand over another one, close enough to rest on it? One is clear if none rests on it.

    A larger `above_most` includes an object that is released there and falls onto the other one.
    """
    own, other = standing_extents(upper, upper_pose), standing_extents(lower, lower_pose)
    x, y, z = (a - b for a, b in zip(upper_pose.position, lower_pose.position, strict=True))
    height = 2 * min(own[2], other[2])
    gap = z - (own[2] + other[2] - height)
    above = GEOMETRY.above_least * height < gap < above_most * height
    return above and abs(x) < own[0] + other[0] and abs(y) < own[1] + other[1]


def is_reachable(thing: Object, height: float, lowest_top: float) -> bool:
    """Is an object with its centre at this height not below the lowest table's top, that is, not on the floor?"""
    return height > lowest_top - GEOMETRY.seated * thing.height


def is_in_reach(task: Task, poses: Poses, name: str) -> bool:
    """Is an object where the gripper can go from where the robot is, and not on the floor?"""
    return is_off_floor(task, poses, name) and is_within_reach(task, poses, poses[name].position)


def is_within_reach(task: Task, poses: Poses, point: Vec3) -> bool:
    """Is a point no farther from a robot that drives than its arm reaches? One that does not drive reaches all."""
    return task.robot.base is None or math.dist(poses[BASE].position, point) <= task.robot.base.reach


def is_off_floor(task: Task, poses: Poses, name: str) -> bool:
    """Is an object not on the floor?"""
    over_robot = min(table.top for table in task.tables) - task.robot_position[2]
    lowest = poses[task.robot_frame].position[2] + over_robot
    return is_reachable(task.thing(name), poses[name].position[2], lowest)


def is_clear(task: Task, poses: Poses, name: str, *, held: str | None = None) -> bool:
    """Does no object rest on this one? A held one rests on nothing, and nothing on it."""
    others = (other for other in task.object_names if other in poses and other not in (name, held))
    here = task.thing(name), poses[name]
    return name == held or not any(rests_on(task.thing(other), poses[other], *here) for other in others)


def is_graspable(task: Task, poses: Poses, name: str) -> bool:
    """Does an object stand so that the gripper can take it? That is along a pair of parallel faces that fits the opening,
    or along one of the frame's axes if it is round, where both fingers have `finger_room` beside it, down to its middle."""
    if not is_upright(task.thing(name), poses[name]):
        return False
    return not task.finger_room or None in fingers_meet(task, poses, name)


def fingers_meet(task: Task, poses: Poses, name: str) -> list[str | None]:
    """Return the object, kit or table that the fingers would meet beside an object, None where they have room, along each
    pair of upright faces that fits the gripper's opening. Fingers are squares of `finger_room` along these faces."""
    thing, pose = task.thing(name), poses[name]
    reach = task.finger_room / 2
    met = []
    for width, (x, y, _) in zip(thing.size, _across_faces(thing, pose), strict=False):
        if width <= task.gripper_opening:
            fingers = [
                Footprint(
                    (pose.position[0] + away * x, pose.position[1] + away * y),
                    (reach, reach),
                    math.degrees(math.atan2(y, x)),
                )
                for away in (-width / 2 - reach, width / 2 + reach)
            ]
            met.append(next((other for finger in fingers for other in _beside(task, poses, name, finger)), None))
    return met


def footprint(thing: Object, pose: Pose) -> Footprint:
    """Return what an object covers, seen from above: a circle if it is an upright cylinder, else a rectangle along its
    heading."""
    turn = heading(pose)
    back = Pose((0.0, 0.0, 0.0), (math.cos(turn / 2), 0.0, 0.0, -math.sin(turn / 2)))
    x, y, _ = extents(thing, back.compose(pose))
    is_round = thing.shape == "cylinder" and is_upright(thing, pose)
    return Footprint(pose.position[:2], (x, y), math.degrees(turn), is_round)


def in_own_target(task: Task, poses: Poses, *, held: str | None = None) -> frozenset[str]:
    """Return the instances that stand in a target of theirs, which names them or their part: in each target the nearest of
    those that are at it."""
    found = set()
    for target in task.targets:
        there = [name for name in task.instances[target.object] if _stands_in(task, poses, target, name, held)]
        if there and task.thing(there[0]).part:
            frame = poses[target.frame]
            found.add(min(there, key=lambda name: _distance(poses[name], frame, target.position)))
    return frozenset(found)


def can_be_taken(task: Task, poses: Poses, name: str, *, held: str | None = None) -> bool:
    """Can an open and empty gripper take an object: is it clear, within reach and graspable?"""
    return is_loose(task, poses, name, held=held) and is_in_reach(task, poses, name)


def is_loose(task: Task, poses: Poses, name: str, *, held: str | None = None) -> bool:
    """Can an open and empty gripper take an object once it is within reach: is it clear, graspable and not on the floor?"""
    return (
        is_clear(task, poses, name, held=held) and is_off_floor(task, poses, name) and is_graspable(task, poses, name)
    )


def taken_by(task: Task, poses: Poses, name: str, *, held: str | None = None) -> str | None:
    """Return which object a `pick` of an object or a part takes, or None if none can be taken: of a part, the nearest to the
    robot that does not stand in a target of its own; of several, the one with the lowest x, then y."""
    if name in task.object_names:
        return name if name in poses and can_be_taken(task, poses, name, held=held) else None
    done = in_own_target(task, poses, held=held)
    left = [one for one in task.instances[name] if one in poses and one not in done]
    robot = poses[task.robot_frame if task.robot.base is None else BASE].position[:2]
    candidates = [one for one in left if can_be_taken(task, poses, one, held=held)]
    return min(
        candidates, key=lambda one: (math.dist(poses[one].position[:2], robot), *poses[one].position[:2]), default=None
    )


def _stands_in(task: Task, poses: Poses, target: Target, name: str, held: str | None) -> bool:
    """Is an instance, which is not in the gripper and not the frame itself, at a target?"""
    if name not in poses or target.frame not in poses or name in (held, target.frame):
        return False
    place = poses[target.frame], target.position
    return is_at(task.thing(name), poses[name], *place, turn=target.turn, episode=task.episode)


def _distance(pose: Pose, frame: Pose, position: Vec3) -> float:
    return math.dist(pose.position, frame.apply(position))


def _across_faces(thing: Object, pose: Pose) -> list[Vec3]:
    """Return the directions across the two pairs of upright faces; a cube may lie on any, and round ones have none, for
    which it is the frame's axes."""
    turned = Pose((0.0, 0.0, 0.0)) if thing.shape == "cylinder" else Pose((0.0, 0.0, 0.0), pose.quaternion)
    axes: list[Vec3] = [tuple(turned.apply(unit).tolist()) for unit in UNITS]
    steepest = max(range(3), key=lambda i: abs(axes[i][2]))
    return [axes[2 if i == steepest else i] for i in (0, 1)]


def _beside(task: Task, poses: Poses, name: str, finger: Footprint) -> Iterator[str]:
    """Yield what a finger would meet beside an object."""
    height = poses[name].position[2]
    top = height + standing_extents(task.thing(name), poses[name])[2]
    for other in task.object_names:
        if other == name or other not in poses:
            continue
        thing, pose = task.thing(other), poses[other]
        half, z = extents(thing, pose)[2], pose.position[2]
        if z + half > height and z - half < top and overlap(finger, footprint(thing, pose)) > 0:
            yield other
    for owner, fixed, level in _fixed(task, poses):
        if level > height and overlap(finger, fixed) > 0:
            yield owner


def _fixed(task: Task, poses: Poses) -> Iterator[tuple[str, Footprint, float]]:
    """Yield the tables, and the plate and the walls of the kits: the name of each, what it covers, and how high its top
    is."""

    def of(frame: str, middle: Vec2, half: Vec2, level: float) -> tuple[str, Footprint, float]:
        x, y, z = poses[frame].apply((*middle, level)).tolist()
        return frame, Footprint((x, y), half, math.degrees(heading(poses[frame]))), z

    x, y, z = task.robot_position
    for table in task.tables:
        middle, half = (table.position[0] - x, table.position[1] - y), (table.size[0] / 2, table.size[1] / 2)
        yield table.name, *of(task.robot_frame, middle, half, table.top - z)[1:]
    for kit in task.kits:
        if kit.name in poses:
            yield of(kit.name, (0.0, 0.0), kit.half, kit.plate)
            for middle, half in kit.walls():
                yield of(kit.name, middle, half, kit.rim)
