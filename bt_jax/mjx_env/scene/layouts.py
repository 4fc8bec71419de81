"""Where an episode starts: the kit in the middle of one table, the boxes on the others."""

from __future__ import annotations

import dataclasses

import numpy as np

from bt_jax.mjx_env.scene.placement import draw_kit_table, draw_places
from bt_jax.mjx_env.semantics import subgoals_by_sight
from bt_jax.mjx_env.world import World, snap
from bt_jax.tasks import Task

__all__ = ["sample_layouts"]


def sample_layouts(task: Task, seed: int | list[int], count: int) -> World:
    """Return `count` initial states (NumPy), the same for the same seed. The gripper is open and empty."""
    rng = np.random.default_rng(seed)
    kit = np.zeros((count, 3), np.float32)
    poses = np.zeros((count, len(task.boxes), 7), np.float32)
    poses[..., 3] = 1
    for k in range(count):
        kit_table = draw_kit_table(task, rng)
        table = task.tables[kit_table]
        kit[k] = (*table.position[:2], table.top + task.kit.thickness / 2)
        poses[k, :, :3] = draw_places(task, rng, kit_table)
    world = World(
        kit=kit,
        poses=snap(poses),
        held=np.full(count, -1, np.int8),
        gripper_open=np.ones(count, bool),
        reached=np.zeros((count, len(task.subgoals)), bool),
    )
    return dataclasses.replace(world, reached=subgoals_by_sight(task, world))
