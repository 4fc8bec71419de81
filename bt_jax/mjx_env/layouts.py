"""Where an episode starts: the kit in the middle of one table, the boxes on the others."""

from __future__ import annotations

import dataclasses

import numpy as np

from bt_jax.errors import UserError
from bt_jax.mjx_env.statuses import see_subgoals
from bt_jax.mjx_env.world import World, snap
from bt_jax.task import Task

__all__ = ["sample_layouts"]

TRIES = 1000


def sample_layouts(task: Task, seed: int | list[int], count: int) -> World:
    """`count` initial states (NumPy), the same for the same seed. The gripper is open and empty."""
    rng = np.random.default_rng(seed)
    kit = np.zeros((count, 3), np.float32)
    poses = np.zeros((count, len(task.boxes), 7), np.float32)
    poses[..., 3] = 1
    for k in range(count):
        kit_table = _kit_table(task, rng)
        table = task.tables[kit_table]
        kit[k] = (*table.position[:2], table.top + task.kit.thickness / 2)
        poses[k, :, :3] = _place_boxes(task, rng, kit_table)
    world = World(
        kit=kit,
        poses=snap(poses),
        held=np.full(count, -1, np.int8),
        opened=np.ones(count, bool),
        reached=np.zeros((count, len(task.subgoals)), bool),
    )
    return dataclasses.replace(world, reached=see_subgoals(task, world))


def _kit_table(task: Task, rng: np.random.Generator) -> int:
    names = [table.name for table in task.tables]
    return int(rng.integers(len(names))) if task.layout.kit == "random" else names.index(task.layout.kit)


def _place_boxes(task: Task, rng: np.random.Generator, kit_table: int) -> np.ndarray:
    """Centres [B, 3]: a stack counts as one box at a random place."""
    tables = [table for i, table in enumerate(task.tables) if i != kit_table]
    names, centres = task.box_names, np.zeros((len(task.boxes), 3))
    stack = [names.index(name) for name in task.layout.stack]
    single = [i for i in range(len(names)) if i not in stack]
    groups = [group for group in ([stack] if stack else []) + [[i] for i in single]]
    for _ in range(TRIES):
        spots: list[np.ndarray] = []
        for group in groups:
            table = tables[rng.integers(len(tables))]
            room = np.array(table.size[:2]) / 2 - task.layout.margin
            spot = np.array(table.position[:2]) + rng.uniform(-room, room)
            height = table.top
            for i in group:
                centres[i] = (*spot, height + task.boxes[i].size / 2)
                height += task.boxes[i].size
            spots.append(spot)
        gaps = [np.linalg.norm(a - b) for i, a in enumerate(spots) for b in spots[:i]]
        if not gaps or min(gaps) >= task.layout.spacing:
            return centres
    raise UserError(
        f"task {task.name}: no room for all boxes after {TRIES} tries; lower layout.spacing or layout.margin"
    )
