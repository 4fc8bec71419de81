"""The scenes in which a demonstration was recorded, from the poses of the end effector in every frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from bt_jax._util.errors import UserError
from bt_jax.app.plain_words import Words
from bt_jax.lfd import Action, Demonstration, Frames
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.teaching.teleoperation import Teleoperation

__all__ = ["Scene", "described", "handled", "scenes", "world_of"]

CARRY = 1.5  # how high a box is lifted before it is carried, in its sizes


@dataclasses.dataclass(frozen=True)
class Scene:
    """One picture of a replay: a batch of one state, and what is happening."""

    world: World
    sentence: str


def scenes(demonstration: Demonstration, frames: Frames, task: Task, physics: Physics) -> list[Scene]:
    """What one sees when a demonstration is played again: for each action, the scene as it was recorded, and the way there.

    Raises UserError where it was recorded with boxes that the task does not have.
    """
    for name in task.frames:
        if name not in frames.names:
            raise UserError(
                f"{demonstration.name} was recorded without {name}; choose the task that it was recorded in"
            )
    return list(_scenes(demonstration, frames, task, physics))


def _scenes(demonstration: Demonstration, frames: Frames, task: Task, physics: Physics) -> Iterator[Scene]:
    names, count = handled(demonstration, frames), len(demonstration.actions)
    for i, (action, name) in enumerate(zip(demonstration.actions, names, strict=True)):
        world, sentence = world_of(action, task), f"{i + 1} of {count}: {described(action, name, task)}"
        index = task.box_names.index(name)
        up = np.array([0, 0, CARRY * task.boxes[index].size], np.float32)
        if action.kind == "pick":
            yield Scene(world, sentence)
            yield Scene(_held(world, index, up), sentence)
        else:
            yield Scene(_held(world, index, up), sentence)
            yield Scene(_held(world, index, np.zeros(3, np.float32)), sentence)
            if i == count - 1:
                yield Scene(_at_rest(task, physics, _held(world, index, up), action, name), sentence)


def handled(demonstration: Demonstration, frames: Frames) -> list[str]:
    """The object that each action handles."""
    found: list[str] = []
    for action in demonstration.actions:
        found.append(action.nearest(frames.objects) if action.kind == "pick" or not found else found[-1])
    return found


def world_of(action: Action, task: Task) -> World:
    """The scene at the moment of an action, a batch of one state (NumPy) with an open, empty gripper."""
    poses = np.array([_pose(action, name, task) for name in task.box_names], np.float32)
    kit = _pose(action, task.kit.name, task)[:3].astype(np.float32)
    return World(
        kit=kit[None],
        poses=poses[None],
        held=np.array([-1], np.int8),
        gripper_open=np.array([True]),
        reached=np.zeros((1, len(task.subgoals)), bool),
    )


def described(action: Action, name: str, task: Task) -> str:
    """What an action on the object `name` does, in plain words: by what is below, else by the table."""
    words = Words(task)
    if action.kind == "pick":
        return f"Pick up {name}"
    size, half = next(box.size for box in task.boxes if box.name == name), task.kit.size / 2
    for box in task.boxes:
        if box.name != name and box.name in action.poses:
            x, y, z = action.handled(box.name)
            middle = (size + box.size) / 2
            if max(abs(x), abs(y)) < middle and 0.6 * middle < z < 1.5 * middle:
                return f"Put {name} {words.place(name, (x, y, z), box.name)}"
    x, y, z = action.handled(task.kit.name)
    if max(abs(x), abs(y)) < half and abs(z) < half:
        return f"Put {name} {words.place(name, (x, y, z), task.kit.name)}"
    position = tuple(float(value) for value in action.handled(task.robot_frame))
    return f"Put {name} {words.place(name, position, task.robot_frame)}"


def _pose(action: Action, frame: str, task: Task) -> Float[np.ndarray, "7"]:
    """A frame in the world: position [m] and quaternion wxyz."""
    in_robot, in_frame = action.poses[task.robot_frame], action.poses[frame]
    turn = Rotation.from_quat(in_robot.quaternion) * Rotation.from_quat(in_frame.quaternion).inv()
    position = np.array(in_robot.position) - turn.apply(in_frame.position) + task.robot_position
    return np.concatenate([position, turn.as_quat(canonical=True, scalar_first=True)])


def _held(world: World, index: int, up: Float[np.ndarray, "3"]) -> World:
    poses = world.poses.copy()
    poses[0, index, :3] += up
    return dataclasses.replace(world, poses=poses, held=np.array([index], np.int8), gripper_open=np.array([False]))


def _at_rest(task: Task, physics: Physics, before: World, action: Action, name: str) -> World:
    """Once it has been let go; where physics differs too much from the recording to do that, as it was recorded."""
    recorded = world_of(action, task)
    hand = Teleoperation(task, physics, recorded)
    try:
        hand.pick(name)
        hand.move_to(action.handled(task.robot_frame), task.robot_frame)
        hand.release()
    except UserError:
        return recorded
    return hand.world
