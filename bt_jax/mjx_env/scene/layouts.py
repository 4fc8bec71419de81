"""Where an episode starts: the kits on their tables, the objects on the others, a base where the task has it."""

from __future__ import annotations

import dataclasses

import numpy as np

from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.driving import start
from bt_jax.mjx_env.scene.placement import draw_kit_table, draw_poses
from bt_jax.mjx_env.world import World, snap
from bt_jax.tasks import Task
from bt_jax.tasks.support import kit_origin

__all__ = ["sample_layouts"]


def sample_layouts(task: Task, seed: int | list[int], count: int) -> World:
    """Return `count` initial states (NumPy), the same for the same seed. The gripper is open and empty."""
    rng = np.random.default_rng(seed)
    kits = np.zeros((count, len(task.kits), 3), np.float32)
    poses = np.zeros((count, len(task.objects), 7), np.float32)
    for k in range(count):
        kit_table = task.tables[draw_kit_table(task, rng)]
        kits[k] = [kit_origin(task, kit_table, name) for name in task.kit_names]
        poses[k] = draw_poses(task, rng, kit_table)
    world = World(
        kits=kits,
        poses=snap(poses),
        held=np.full(count, -1, np.int8),
        gripper_open=np.ones(count, bool),
        reached=np.zeros((count, len(task.subgoals)), bool),
        unseen=None if task.faults is None else np.zeros((count, len(task.objects)), bool),
        base=start(task, count),
    )
    return dataclasses.replace(world, reached=subgoals_by_sight(task, world))
