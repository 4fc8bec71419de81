"""Why an episode did not solve its task, in one sentence for people."""

from __future__ import annotations

import math

import numpy as np

from bt_jax.behaviors import Vocabulary
from bt_jax.behaviors.geometry import (
    Poses,
    fingers_meet,
    in_own_target,
    is_at,
    is_loose,
    is_off_floor,
    is_upright,
    is_within_reach,
    rests_on,
    standing_extents,
    turn_error,
)
from bt_jax.behaviors.pose import Pose
from bt_jax.mjx_env.episodes.fault_reasons import why_mishap, why_moved, why_unknown
from bt_jax.mjx_env.episodes.playback import Playback, Tick
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act
from bt_jax.mjx_env.surfaces import (
    fixed_surfaces,
    joined,
    object_surfaces,
    outline_of,
    overlaps,
    surface_names,
)
from bt_jax.mjx_env.world import World, frames, poses_by_name, to_world
from bt_jax.tasks import Target, Task
from bt_jax.tasks.things import Vec3

__all__ = ["explain_failure"]

ENDINGS = {
    Ending.FAILURE: "everything is in its place, but the tree fails",
    Ending.TIMEOUT: "everything is in its place, but the tree does not succeed in time",
    Ending.BROKEN: "the simulation diverged",
}


def explain_failure(task: Task, playback: Playback) -> str:
    """Return why a playback that is not solved did not solve the task: what kept the first target from being met.

    "the kit is where BlueBox should be put"
    """
    assert not playback.solved
    if playback.ending == Ending.BROKEN:
        return ENDINGS[Ending.BROKEN]
    if reason := why_unknown(task, playback):
        return reason
    missed = [target for target, met in zip(task.targets, playback.misses.met, strict=True) if not met]
    return _why_missed(task, playback, missed[0]) if missed else ENDINGS[playback.ending]


def _why_missed(task: Task, playback: Playback, target: Target) -> str:
    name, final = target.object, playback.final
    poses, held = poses_by_name(final, task), _held(task, final)
    puts = [tick for tick in playback.ticks if _puts(tick) and _carried(task, tick) in task.instances[name]]
    if len(task.instances[name]) > 1:
        puts = [tick for tick in puts if _is_meant(task, tick, target)]
    if puts and not _arrived(task, puts[-1]):
        return why_mishap(task, puts[-1], _carried(task, puts[-1])) or _why_not_there(task, puts[-1])
    if puts and _is_met(task, puts[-1].after, target):
        one = _carried(task, puts[-1])
        if is_upright(task.thing(one), poses[one]) and is_off_floor(task, poses, one):
            return why_moved(playback, puts[-1], one) or f"{one} does not stay in its place"
    inside = [other for other in task.object_names if other != held and _is_inside(task, poses, target, other)]
    own = [other for other in inside if other in task.instances[name]]
    if own:
        return _why_not_right(task, poses, target, own[0])
    if held in task.instances[name]:
        place = _goal_of(poses, target)
        far = _why_far(task, poses, f"the place of {held}", place, _approached(playback, target.frame))
        return far or f"{held} is still in the gripper"
    if inside and target.slot:
        return f"{inside[0]} is in {target.slot}, where {name} should be put"
    if len(task.instances[name]) == 1:
        return _why_elsewhere(task, playback, poses, target, is_put=bool(puts))
    return _why_none_is_left(task, playback, poses, target, held)


def _why_not_right(task: Task, poses: Poses, target: Target, one: str) -> str:
    """Return what is wrong with an object that is where it should be."""
    thing, pose = task.thing(one), poses[one]
    if not is_upright(thing, pose):
        return f"{one} has toppled"
    off = 0.0 if target.turn is None else turn_error(thing, pose, poses[target.frame], target.turn)
    if abs(off) >= math.radians(task.episode.turn_tolerance):
        return f"{one} is in its place, but turned by {abs(math.degrees(off)):.0f} degrees from how it should lie"
    return f"{one} is put somewhere else"


def _approached(playback: Playback, *names: str) -> bool:
    """Does the robot drive towards one of these, or towards a place in its frame?"""
    commands = [tick.command for tick in playback.ticks if tick.command is not None]
    return any(command.name == "approach" and command.object in names for command in commands)


def _why_far(task: Task, poses: Poses, what: str, point: Vec3, is_approached: bool) -> str:
    """Return that something is out of reach, or an empty text."""
    if is_within_reach(task, poses, point):
        return ""
    return f"{what} is out of reach: {'the robot is still on its way' if is_approached else 'nothing approaches it'}"


def _why_elsewhere(task: Task, playback: Playback, poses: Poses, target: Target, *, is_put: bool) -> str:
    """Return why the only object of a name is not near its target."""
    name = target.object
    trouble = _why_lost(task, poses, name)
    if trouble:
        return trouble
    kit = _kit_under(task, poses, name)
    if is_put and kit and target.frame in task.kit_names and kit != target.frame:
        return f"{name} stands in {kit} instead of {target.frame}"
    if is_put:
        return f"{name} is put somewhere else"
    far = _why_far(task, poses, name, poses[name].position, _approached(playback, name))
    return _why_not_taken(task, poses, name) or far or f"{name} is never put anywhere"


def _why_none_is_left(task: Task, playback: Playback, poses: Poses, target: Target, held: str | None) -> str:
    """Return why no instance of a part is at a target."""
    part = target.object
    done = in_own_target(task, poses, held=held)
    left = [one for one in task.instances[part] if one not in done]
    loose = [one for one in left if is_loose(task, poses, one)]
    far = [_why_far(task, poses, part, poses[one].position, _approached(playback, part, one)) for one in loose]
    if loose and all(far):
        return far[0]
    if loose:
        return f"no {part} is put in {target.slot}" if target.slot else f"no {part} is put in its place"
    reasons = [reason for one in left if (reason := _why_lost(task, poses, one) or _why_not_taken(task, poses, one))]
    return f"no {part} is left to take{f': {reasons[0]}' if reasons else ''}"


def _why_lost(task: Task, poses: Poses, name: str) -> str:
    """Return what has happened to an object that can neither be taken nor count as in its place, or an empty text."""
    if not is_off_floor(task, poses, name):
        return f"{name} has fallen to the floor"
    return "" if is_upright(task.thing(name), poses[name]) else f"{name} has toppled"


def _why_not_taken(task: Task, poses: Poses, name: str) -> str:
    """Return why the gripper cannot take an upright object within reach, or an empty text."""
    thing = task.thing(name)
    for other in task.object_names:
        if other != name and rests_on(task.thing(other), poses[other], thing, poses[name]):
            return f"{other} stands on {name} and is not taken away"
    met = fingers_meet(task, poses, name) if task.finger_room else [None]
    if None in met:
        return ""
    if not met:
        return f"{name} is too wide for the gripper"
    near = list(dict.fromkeys(map(str, met)))
    wide = ", and it is too wide for the gripper the other way" if len(met) == 1 else ""
    verb = "are" if len(near) > 1 else "is"
    return f"the fingers have no room beside {name}: {' and '.join(near)} {verb} too near{wide}"


def _is_inside(task: Task, poses: Poses, target: Target, name: str) -> bool:
    """Is the middle of an object at a target, seen from above, and not on something that is there?"""
    if name == target.frame:
        return False
    goal, (x, y, z) = _goal_of(poses, target), poses[name].position
    half = standing_extents(task.thing(name), poses[name])[2]
    own = task.thing(target.object).height / 2
    return math.dist(goal[:2], (x, y)) < task.episode.tolerance and abs((z - half) - (goal[2] - own)) < own


def _goal_of(poses: Poses, target: Target) -> Vec3:
    x, y, z = poses[target.frame].apply(target.position).tolist()
    return x, y, z


def _kit_under(task: Task, poses: Poses, name: str) -> str | None:
    """Return the kit over which the middle of an object is."""
    for kit in task.kits:
        x, y, _ = poses[kit.name].inverse().apply(poses[name].position)
        if abs(x) < kit.half[0] and abs(y) < kit.half[1]:
            return kit.name
    return None


def _puts(tick: Tick) -> bool:
    """Does a tick put something somewhere?"""
    return tick.command is not None and tick.command.name == "place"


def _is_meant(task: Task, tick: Tick, target: Target) -> bool:
    """Does a `place` put its object where a target is?"""
    place = _in_world(task, tick.before, target.frame, target.position)
    return math.dist(_goal(task, tick), place) < task.episode.tolerance


def _arrived(task: Task, tick: Tick) -> bool:
    """Return whether a `place` has left its object where it should be."""
    return math.dist(_centre(task, tick.after, _carried(task, tick)), _goal(task, tick)) < task.episode.tolerance


def _why_not_there(task: Task, tick: Tick) -> str:
    """Return what is in the way of a `place` whose object ended elsewhere, or that nothing is there to carry it."""
    name, goal, released = _carried(task, tick), _goal(task, tick), _released(task, tick)
    after = poses_by_name(tick.after, task)[name]
    top, support = max(_tops_under(task, tick.before, name, released))
    half = standing_extents(task.thing(name), released)[2]
    if goal[2] - (top + half) > task.episode.tolerance:
        return f"nothing is under the place where {name} should be put"
    raised = top + half - goal[2] > task.episode.tolerance
    if raised or math.dist(after.position, released.position) < task.episode.tolerance:
        return f"{support} {'are' if support.startswith('the walls') else 'is'} where {name} should be put"
    if not is_upright(task.thing(name), after):
        return f"{name} topples from {support}, where it is put"
    return f"{name} does not stay on {support} where it is put"


def _released(task: Task, tick: Tick) -> Pose:
    """Return the pose at which a `place` lets go of its object."""
    assert tick.command is not None
    semantics = LeafSemantics(task, Vocabulary.of([tick.command]))
    command = np.array([semantics.commands.index(tick.command)], np.int32)
    return poses_by_name(act(semantics, tick.before, command, tick.mishaps).world, task)[_carried(task, tick)]


def _tops_under(task: Task, world: World, name: str, released: Pose) -> list[tuple[float, str]]:
    """Return what is under an object where it is let go: how high the top of each is in the world, metres, and its name."""
    surfaces = joined(fixed_surfaces(task, world.kits), object_surfaces(task, world.poses))
    xy, quaternion = (np.array([part], np.float32) for part in (released.position[:2], released.quaternion))
    which = np.array([task.object_names.index(name)])
    half = np.array([standing_extents(task.thing(name), released)[:2]], np.float32)
    under = overlaps(surfaces, xy, half, outline_of(task, quaternion, which))[0]
    under[0] = True  # the floor is everywhere
    labels = [*_surface_labels(task), *task.object_names]
    return [
        (float(top), label)
        for top, label, here in zip(surfaces.top[0], labels, under, strict=True)
        if here and label != name
    ]


def _surface_labels(task: Task) -> list[str]:
    """Return what people call each of the fixed surfaces; the first of a kit is its plate."""
    names, labels = surface_names(task), []
    for i, name in enumerate(names):
        kit = "the kit" if name in task.kit_names and len(task.kits) == 1 else name
        labels.append(f"the walls of {kit}" if name in names[:i] else kit)
    return labels


def _is_met(task: Task, world: World, target: Target) -> bool:
    poses = poses_by_name(world, task)
    place = poses[target.frame], target.position
    return any(
        is_at(task.thing(one), poses[one], *place, turn=target.turn, episode=task.episode)
        for one in task.instances[target.object]
    )


def _held(task: Task, world: World) -> str | None:
    index = int(world.held[0])
    return task.object_names[index] if index >= 0 else None


def _carried(task: Task, tick: Tick) -> str:
    """Return the object that a `place` puts somewhere."""
    return str(_held(task, tick.before))


def _goal(task: Task, tick: Tick) -> list[float]:
    """Return where a `place` should leave its object, metres in the world [3]."""
    assert tick.command is not None
    assert tick.command.position is not None
    return _in_world(task, tick.before, str(tick.command.frame), tick.command.position)


def _in_world(task: Task, world: World, frame: str, position: Vec3) -> list[float]:
    index = np.array([task.frames.index(frame)])
    return np.asarray(to_world(frames(world, task), index, np.array([position], np.float32)))[0, 0].tolist()


def _centre(task: Task, world: World, name: str) -> list[float]:
    """Return where the centre of an object is, metres in the world [3]."""
    return np.asarray(world.poses)[0, task.object_names.index(name), :3].tolist()
