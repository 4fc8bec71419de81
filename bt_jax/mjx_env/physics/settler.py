"""Settling problems, each distinct one once.

What a released object does depends only on what is near it. A problem is therefore reduced to its neighbourhood before it
is solved: the objects within reach, seen from their table, equal bodies being interchangeable. Stacking two boxes in the kit
is then one problem, whichever boxes and whichever table. Where the solution shows that something moved far enough to
meet what was left out, the whole scene is solved instead, so the reduction never changes what can happen.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from bt_jax.mjx_env.physics.neighbourhood import REACH, neighbours
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.skills import Released
from bt_jax.mjx_env.world import POSITION_GRID, ROTATION_GRID, order_of_rows, row_names, snap
from bt_jax.tasks import Task

__all__ = ["Settler"]

STILL = 0.005  # an object that moved sideways by less than this part of its longest edge has stayed in place
AWAY = 1000.0  # x of the first kit if it is on another table, metres; of the second twice as far, and so on
MEMORY = 1 << 30  # bytes
ENTRY_BYTES = 450  # of a solution, besides its numbers


@dataclasses.dataclass
class Settler:
    """Solves settling problems with a physics backend and remembers the solutions, in at most about `memory` bytes: once
    these are full, it forgets all and begins again.

    `asked` counts problems posed, `solved` those that were simulated, `steps` the physics steps that took.
    """

    task: Task
    physics: Physics
    memory: int = MEMORY
    asked: int = 0
    solved: int = 0
    steps: int = 0

    def __post_init__(self) -> None:
        self._solutions: dict[bytes, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}  # poses, ok and reach
        self._most = self.memory // (ENTRY_BYTES + 4 * (4 + 15 * len(self.task.objects)))  # solutions
        objects = self.task.objects
        self._sizes = np.array([thing.edge for thing in objects], np.float32)
        self._radii = np.array([REACH * thing.edge if thing.is_cube else thing.radius for thing in objects], np.float32)
        self._away = np.array([[[AWAY * (k + 1), 0, 0] for k in range(len(self.task.kits))]], np.float32)
        self._twins = _groups([thing.body for thing in objects])
        tables = self.task.tables
        self._centres = np.array([table.position[:2] for table in tables], np.float32)
        self._half_widths = np.array([table.size[:2] for table in tables], np.float32) / 2
        first = {i: g[0] for g in _groups([(table.size, table.position[2]) for table in tables]) for i in g}
        positions = np.array([table.position for table in tables], np.float32)
        # From the first table of the same shape to each table: what is added to a pose.
        self._offsets = np.zeros((len(tables), 7), np.float32)
        self._offsets[:, :3] = positions - positions[[first[i] for i in range(len(tables))]]

    def settle(self, released: Released) -> tuple[Float32[np.ndarray, "S B 7"], Bool[np.ndarray, " S"]]:
        """Return the poses of all boxes at rest (metres, world; quaternion wxyz), and False where the simulation
        diverged, or was to begin with a pose that is not finite."""
        poses, ok = released.poses.copy(), np.isfinite(released.poses).all(axis=(1, 2))
        near = neighbours(self.task, released)
        rows = np.flatnonzero(near.any(axis=1) & ok)
        self.asked += len(rows)
        if rows.size:
            start, kits, present = released.poses[rows], released.world.kits[rows], released.present[rows]
            table = self._nearest_table(released, rows)
            centre, half, offset = self._centres[table], self._half_widths[table], self._offsets[table][:, None]
            here = (np.abs(kits[..., :2] - centre[:, None]) < half[:, None]).all(axis=-1)
            local_kits = np.where(here[..., None], kits - offset[..., :3], self._away)
            rest, fine, reach = self._solve(local_kits, start - offset, near[rows])
            rest = rest + offset
            far = ~self._is_local(start, near[rows], present, reach, centre, half)
            poses[rows], ok[rows] = np.where(near[rows][..., None], rest, start), fine
            if far.any():
                whole = rows[far]
                poses[whole], ok[whole], _ = self._solve(kits[far], start[far], present[far])
        return poses, ok

    def _nearest_table(self, released: Released, rows: np.ndarray) -> Int[np.ndarray, " S"]:
        """Return the index of the table nearest to the handled box, for the given rows."""
        here = released.poses[rows, released.box[rows], :2]
        return np.argmin(np.linalg.norm(self._centres - here[:, None], axis=-1), axis=1)

    def _is_local(
        self,
        start: Float32[np.ndarray, "S B 7"],
        near: Bool[np.ndarray, "S B"],
        present: Bool[np.ndarray, "S B"],
        reach: Float32[np.ndarray, "S B"],
        centre: Float32[np.ndarray, "S 2"],
        half: Float32[np.ndarray, "S 2"],
    ) -> Bool[np.ndarray, " S"]:
        """Return whether every box stays over its table and nothing that moved could have met a box that was left out."""
        moved = near & (reach > STILL * self._sizes)
        body = self._radii
        extent = np.abs(start[..., :2] - centre[:, None]) + (reach + body)[..., None]
        leaves = near & (extent > half[:, None]).any(axis=-1)
        gap = np.linalg.norm(start[:, :, None, :2] - start[:, None, :, :2], axis=-1)
        meets = moved[:, :, None] & (present & ~near)[:, None] & (gap < (reach + body)[:, :, None] + body)
        return ~leaves.any(axis=1) & ~meets.any(axis=(1, 2))

    def _solve(
        self, kits: Float32[np.ndarray, "S T 3"], poses: Float32[np.ndarray, "S B 7"], present: Bool[np.ndarray, "S B"]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return poses, ok and reach; only problems that are new are simulated."""
        records = _records(poses, present)
        order = self._canonical_order(records)
        records = np.take_along_axis(records, order[..., None], axis=1)
        places = np.rint(kits / POSITION_GRID).astype(np.int32).reshape(len(kits), -1)
        keys = np.concatenate([places, records.reshape(len(kits), -1)], axis=1)
        names = row_names(keys)
        new = {name: i for i, name in enumerate(names) if name not in self._solutions}
        if len(self._solutions) + len(new) > self._most:
            self._solutions.clear()
            new = {name: i for i, name in enumerate(names)}
        if new:
            rows = np.array(list(new.values()))
            each = order[rows]
            sorted_present = np.take_along_axis(present[rows], each, axis=1)
            sorted_poses = snap(np.take_along_axis(poses[rows], each[..., None], axis=1))
            self._simulate(list(new), _snapped(kits[rows]), sorted_poses, sorted_present)
        rest, ok, reach = map(np.array, zip(*[self._solutions[name] for name in names], strict=True))
        back = np.argsort(order, axis=1)
        return np.take_along_axis(rest, back[..., None], axis=1), ok, np.take_along_axis(reach, back, axis=1)

    def _simulate(self, names: list[bytes], kits: np.ndarray, poses: np.ndarray, present: np.ndarray) -> None:
        settled = self.physics.settle(kits, poses, present)
        self.solved += len(names)
        self.steps += int(np.asarray(settled.steps).sum())
        solutions = zip(np.asarray(settled.poses), np.asarray(settled.ok), np.asarray(settled.reach), strict=True)
        self._solutions.update(zip(names, solutions, strict=True))

    def _canonical_order(self, records: Int32[np.ndarray, "S B 7"]) -> Int[np.ndarray, "S B"]:
        """Return the box in each slot: equal boxes are sorted by their records."""
        order = np.tile(np.arange(records.shape[1]), (len(records), 1))
        for group in self._twins:
            order[:, group] = np.array(group)[order_of_rows(records[:, group])]
        return order


def _records(poses: np.ndarray, present: np.ndarray) -> Int32[np.ndarray, "S B 7"]:
    """Return boxes as integers; all that are absent look alike."""
    grid = np.array([POSITION_GRID] * 3 + [ROTATION_GRID] * 4)
    absent = np.iinfo(np.int32).max
    return np.where(present[..., None], np.rint(snap(poses) / grid).astype(np.int32), np.int32(absent))


def _snapped(kits: Float32[np.ndarray, "S T 3"]) -> Float32[np.ndarray, "S T 3"]:
    """Round to the grid of the key, so that the key contains all that the solution depends on."""
    return (np.rint(kits / POSITION_GRID) * POSITION_GRID).astype(np.float32)


def _groups(features: list) -> list[list[int]]:
    """Return the indices of equal features, in order of first appearance."""
    return [[j for j, g in enumerate(features) if g == f] for i, f in enumerate(features) if f not in features[:i]]
