"""Why an episode did not solve its task, in one sentence for people."""

from __future__ import annotations

import math

import numpy as np

from bt_jax.behaviors.geometry import is_at, is_reachable, rests_on
from bt_jax.mjx_env.episodes.playback import Playback, Tick
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.surfaces import fixed_surfaces, object_surfaces, overlaps, surface_names
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
    missed = [target for target, met in zip(task.targets, playback.misses.met, strict=True) if not met]
    return _why_missed(task, playback, missed[0]) if missed else ENDINGS[playback.ending]


def _why_missed(task: Task, playback: Playback, target: Target) -> str:
    name, final = target.object, playback.final
    puts = [
        tick for tick in playback.ticks if tick.command and (tick.command.name, tick.command.object) == ("place", name)
    ]
    if puts and not _arrived(task, puts[-1]):
        return _why_not_there(task, puts[-1])
    lowest = min(table.top for table in task.tables)
    if not is_reachable(task.thing(name), _centre(task, final, name)[2], lowest):
        return f"{name} has fallen to the floor"
    if puts and _is_met(task, puts[-1].after, target):
        return f"{name} does not stay in its place"
    if puts:
        return f"{name} is put somewhere else"
    if final.held[0] == task.object_names.index(name):
        return f"{name} is still in the gripper"
    for other in task.object_names:
        poses = poses_by_name(final, task)
        if other != name and rests_on(task.thing(other), poses[other], task.thing(name), poses[name]):
            return f"{other} stands on {name} and is not taken away"
    return f"{name} is never put anywhere"


def _arrived(task: Task, tick: Tick) -> bool:
    """Return whether a `place` has left its object where it should be."""
    return math.dist(_centre(task, tick.after, _carried(tick)), _goal(task, tick)) < task.episode.tolerance


def _why_not_there(task: Task, tick: Tick) -> str:
    """Return what is in the way of a `place` whose object ended elsewhere, or that nothing is there to carry it."""
    name, goal = _carried(tick), _goal(task, tick)
    half = np.array([task.thing(name).half_at(None)], np.float32)
    names = ["the kit" if thing in task.kit_names and len(task.kits) == 1 else thing for thing in surface_names(task)]
    things = [*names, *task.object_names]
    tops = [(task.floor, "the floor")]
    for surfaces in (fixed_surfaces(task, tick.before.kits), object_surfaces(task, tick.before.poses)):
        under = overlaps(surfaces, np.array([goal[:2]], np.float32), half[:, :2])[0]
        labels, things = things[: len(under)], things[len(under) :]
        tops += [(float(top), label) for top, label, here in zip(surfaces.top[0], labels, under, strict=True) if here]
    top, support = max(entry for entry in tops if entry[1] != name)
    off = goal[2] - (top + float(half[0, 2]))
    if off < -task.episode.tolerance:
        return f"{support} is where {name} should be put"
    if off > task.episode.tolerance:
        return f"nothing is under the place where {name} should be put"
    return f"{name} does not stay on {support} where it is put"


def _is_met(task: Task, world: World, target: Target) -> bool:
    poses, thing = poses_by_name(world, task), task.thing(target.object)
    place = poses[target.frame], target.position
    return is_at(thing, poses[thing.name], *place, turn=target.turn, episode=task.episode)


def _carried(tick: Tick) -> str:
    assert tick.command is not None
    return str(tick.command.object)


def _goal(task: Task, tick: Tick) -> list[float]:
    """Return where a `place` should leave its object, metres in the world [3]."""
    assert tick.command is not None
    assert tick.command.position is not None
    return _in_world(task, tick.before, str(tick.command.frame), tick.command.position)


def _in_world(task: Task, world: World, frame: str, position: Vec3) -> list[float]:
    index = np.array([task.frames.index(frame)])
    return np.asarray(to_world(frames(world, task), index, np.array([position], np.float32)))[0, 0].tolist()


def _centre(task: Task, world: World, name: str) -> list[float]:
    """Return where the centre of a box is, metres in the world [3]."""
    return np.asarray(world.poses)[0, task.object_names.index(name), :3].tolist()
