"""Random states of a task with objects of any shape, parts and trays."""

import dataclasses

import numpy as np

from bt_jax.mjx_env.world import World, snap
from bt_jax.tasks import Task
from bt_jax.tasks.roadmap import roadmap
from bt_jax.tasks.support import kit_origin

TILTS = (0.0, 0.0, 0.0, 0.0, 0.1, 0.5, np.pi / 2, np.pi)  # radians, about a horizontal axis


def random_world(rng: np.random.Generator, task: Task) -> World:
    """One state: objects turned and tilted at random, near the places of the task or near each other, some in stacks."""
    top = min(table.top for table in task.tables)
    kits = np.array([[kit_origin(task, task.tables[0], name) for name in task.kit_names]], np.float32)
    poses = np.zeros((1, len(task.objects), 7), np.float32)
    goals = [(target, task.frames.index(target.frame)) for target in task.targets]
    for i, thing in enumerate(task.objects):
        spot = np.array([*rng.uniform(-0.15, 0.15, 2), top + thing.height / 2 + rng.choice([0, 0, 0, -0.6])])
        kind = rng.integers(3)
        own = [(target, frame) for target, frame in goals if target.object in (thing.name, thing.part)]
        if kind == 1 and own:
            target, frame = own[rng.integers(len(own))]
            origin = kits[0, frame - len(task.objects)] if frame >= len(task.objects) else poses[0, frame, :3]
            spot = origin + target.position + rng.uniform(-0.012, 0.012, 3)
        elif kind == 2 and i:
            below = rng.integers(i)
            height = (task.objects[below].height + thing.height) / 2
            spot = poses[0, below, :3] + [*rng.uniform(-0.05, 0.05, 2), height * rng.choice([1, 1, 0.53, 1.37])]
        turn, tilt = rng.choice([0, 90, 180, 45, -90]) + rng.uniform(-15, 15), rng.choice(TILTS)
        poses[0, i] = (*spot, *_turned(np.radians(turn), tilt + rng.uniform(0, 0.01), rng.uniform(0, np.pi)))
    held = int(rng.integers(-len(task.objects), len(task.objects)))
    return World(
        kits=kits,
        poses=snap(poses),
        held=np.array([max(held, -1)], np.int8),
        gripper_open=np.array([held < 0]),
        reached=np.zeros((1, len(task.subgoals)), bool),
        base=None if task.robot.base is None else _somewhere(rng, task),
    )


def jittered(world: World, rng: np.random.Generator) -> World:
    """The same state but for 0.02 mm and as much of a turn, by which what is near a limit changes."""
    return dataclasses.replace(
        world, poses=world.poses + rng.uniform(-2e-5, 2e-5, world.poses.shape).astype(np.float32)
    )


def swapped(world, rng, groups):
    """The same states with equal objects in any order."""
    count, objects = world.poses.shape[:2]
    order = np.tile(np.arange(objects), (count, 1))
    for own in groups:
        order[:, own] = rng.permuted(np.tile(own, (count, 1)), axis=1)
    rows = np.arange(count)
    held = np.where(world.held < 0, -1, np.argsort(order, axis=1)[rows, world.held])
    return dataclasses.replace(world, poses=world.poses[rows[:, None], order], held=held.astype(np.int8))


def _somewhere(rng: np.random.Generator, task: Task) -> np.ndarray:
    """Any of the places where a base may be, float32[1, 2]."""
    waypoints = np.array(roadmap(task).waypoints, np.float32)
    return waypoints[rng.integers(len(waypoints))][None]


def _turned(turn: float, tilt: float, about: float) -> np.ndarray:
    """A quaternion (wxyz): turned about the vertical, then tilted about a horizontal axis."""
    w, z = np.cos(turn / 2), np.sin(turn / 2)
    c, s = np.cos(tilt / 2), np.sin(tilt / 2)
    a, b = s * np.cos(about), s * np.sin(about)
    return np.array([c * w, a * w + b * z, b * w - a * z, c * z])
