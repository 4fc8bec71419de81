"""A demonstration shown again, from the poses of the end effector that were recorded in every frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bt_jax._util.errors import UserError
from bt_jax.app.plain_words import Words
from bt_jax.lfd import Action, Demonstration, Frames
from bt_jax.lfd.contact import supports
from bt_jax.mjx_env.driving import start
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.teaching.teleoperation import Teleoperation

__all__ = ["ReplayStep", "described", "handled", "replay_steps", "world_of"]

CARRY = 1.5  # how high an object is lifted before it is carried, in its longest edges


@dataclasses.dataclass(frozen=True)
class ReplayStep:
    """One picture of a replay: a batch of one state, and what happens in it."""

    world: World
    sentence: str


def replay_steps(demonstration: Demonstration, frames: Frames, task: Task, physics: Physics) -> list[ReplayStep]:
    """Return the pictures of a replay: for each action, the state as it was recorded, and the way there.

    Raise UserError if the demonstration was recorded without one of the task's objects.
    """
    for name in task.frames:
        if name not in frames.names:
            raise UserError(
                f"{demonstration.name} was recorded without {name}; choose the task that it was recorded in"
            )
    return list(_replay_steps(demonstration, frames, task, physics))


def _replay_steps(demonstration: Demonstration, frames: Frames, task: Task, physics: Physics) -> Iterator[ReplayStep]:
    names, count = handled(demonstration, frames), len(demonstration.actions)
    for i, (action, name) in enumerate(zip(demonstration.actions, names, strict=True)):
        world, sentence = world_of(action, task), f"{i + 1} of {count}: {described(action, name, task)}"
        index = task.object_names.index(name)
        up = np.array([0, 0, CARRY * task.objects[index].edge], np.float32)
        if action.kind == "pick":
            yield ReplayStep(world, sentence)
            yield ReplayStep(_held(world, index, up), sentence)
        else:
            yield ReplayStep(_held(world, index, up), sentence)
            yield ReplayStep(_held(world, index, np.zeros(3, np.float32)), sentence)
            if i == count - 1:
                yield ReplayStep(_at_rest(task, physics, _held(world, index, up), action, name), sentence)


def handled(demonstration: Demonstration, frames: Frames) -> list[str]:
    """Return the object that each action handles."""
    found: list[str] = []
    for action in demonstration.actions:
        found.append(action.nearest(frames.objects) if action.kind == "pick" or not found else found[-1])
    return found


def world_of(action: Action, task: Task) -> World:
    """Return the state during an action, a batch of one (NumPy) with an open, empty gripper."""
    poses = np.array([_pose(action, name, task) for name in task.object_names], np.float32)
    kits = np.array([_pose(action, name, task)[:3] for name in task.kit_names], np.float32)
    return World(
        kits=kits[None],
        poses=poses[None],
        held=np.array([-1], np.int8),
        gripper_open=np.array([True]),
        reached=np.zeros((1, len(task.subgoals)), bool),
        base=start(task, 1),
    )


def described(action: Action, name: str, task: Task) -> str:
    """Say what an action on the object `name` does: by what it is put on."""
    words = Words(task)
    if action.kind == "pick":
        return f"Pick up {name}"
    below = supports(action, name, task)[0]
    x, y, z = action.handled(below)
    return f"Put {name} {words.place(name, (x, y, z), below)}"


def _pose(action: Action, frame: str, task: Task) -> Float[np.ndarray, "7"]:
    """Return a frame in the world: position [m] and quaternion wxyz."""
    in_robot, in_frame = action.poses[task.robot_frame], action.poses[frame]
    turn = (
        Rotation.from_quat(in_robot.quaternion, scalar_first=True)
        * Rotation.from_quat(in_frame.quaternion, scalar_first=True).inv()
    )
    position = np.array(in_robot.position) - turn.apply(in_frame.position) + task.robot_position
    return np.concatenate([position, turn.as_quat(canonical=True, scalar_first=True)])


def _held(world: World, index: int, up: Float[np.ndarray, "3"]) -> World:
    poses = world.poses.copy()
    poses[0, index, :3] += up
    return dataclasses.replace(world, poses=poses, held=np.array([index], np.int8), gripper_open=np.array([False]))


def _at_rest(task: Task, physics: Physics, before: World, action: Action, name: str) -> World:
    """Return the state after the release; as it was recorded if the simulation differs too much for a release."""
    recorded = world_of(action, task)
    hand = Teleoperation(task, physics, recorded)
    try:
        hand.pick(name)
        hand.move_to(action.handled(task.robot_frame), task.robot_frame)
        hand.release()
    except UserError:
        return recorded
    return hand.world
