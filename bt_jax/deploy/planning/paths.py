"""Joint paths and their timing: ways around what is in between, limits of speed and acceleration.

A path is a polyline in joint space. It is first run at the highest speed that each piece allows; two moving averages over
time then make it smooth, which bounds acceleration and jerk (the second derivative of a signal averaged over T is at most
the change of its speed over T). Its ends stay where they are; corners are cut by what is travelled in half the window.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.arrays import JointRows, Joints
from bt_jax.deploy.robot.model import ArmModel

__all__ = ["Pace", "connect", "densified", "timed"]

PERIOD = 0.008  # seconds between the points of a trajectory
RESOLUTION = 0.04  # rad of the largest joint step between two looks at clearance
GROW = 0.25  # rad by which a search tree grows at once
TRIES = 400
SHORTCUTS = 40

Free = Callable[[Joints], bool]
"""free(joints): may the arm be there?"""
Tree = list[tuple[Joints, int]]
"""Configurations, each with the index of its parent; the root's is -1."""


@dataclasses.dataclass(frozen=True)
class Pace:
    """How fast an arm moves: share of the joints' speed limits, joint acceleration [rad/s2], speed of the tool [m/s]."""

    share: float = 0.45
    acceleration: float = 6.0
    tool: float = 0.5

    def slowed(self, factor: float) -> Pace:
        """Return the pace with all speeds `factor` times as high; accelerations follow."""
        return Pace(self.share * factor, self.acceleration * factor, self.tool * factor)


def timed(path: JointRows, pace: Pace, arm: ArmModel) -> Trajectory:
    """Return a path as a trajectory that starts and ends at rest and keeps the pace at every point."""
    path = np.asarray(path, float)
    steps = np.abs(np.diff(path, axis=0))
    path = densified(np.concatenate([path[:1], path[1:][steps.max(axis=1) > 1e-9]]))
    if len(path) == 1:
        return Trajectory(np.array([0.0]), path)
    steps = np.diff(path, axis=0)
    limit = pace.share * arm.speed
    seconds = (np.abs(steps) / limit).max(axis=1)
    tips = np.array([arm.link_poses(joints)[-1, :3, 3] for joints in path])
    seconds = np.maximum(seconds, np.linalg.norm(np.diff(tips, axis=0), axis=1) / pace.tool)
    speed = np.abs(steps / seconds[:, None]).max()
    window = max(2, round(2 * speed / pace.acceleration / PERIOD))
    windows = (window, max(2, window // 2))
    times = np.concatenate([[0], np.cumsum(seconds)])
    grid = np.arange(0, times[-1] + PERIOD, PERIOD)
    rows = np.stack([np.interp(grid, times, column) for column in path.T], axis=1)
    for width in windows:
        rows = _averaged(rows, width)
    rows[0], rows[-1] = path[0], path[-1]
    tips = np.array([arm.link_poses(joints)[-1, :3, 3] for joints in rows])
    fastest = np.linalg.norm(np.diff(tips, axis=0), axis=1).max() / PERIOD
    return Trajectory(PERIOD * np.arange(len(rows)), rows).slowed(max(1.0, fastest / pace.tool))


def _averaged(rows: JointRows, width: int) -> Float[np.ndarray, "m joints"]:
    """Return the moving average of rows that rest at both ends before and after; `width` - 1 rows longer."""
    padded = np.concatenate([np.repeat(rows[:1], width - 1, 0), rows, np.repeat(rows[-1:], width - 1, 0)])
    sums = np.cumsum(np.concatenate([np.zeros((1, rows.shape[1])), padded]), axis=0)
    return (sums[width:] - sums[:-width]) / width


def densified(path: JointRows, resolution: float = RESOLUTION) -> Float[np.ndarray, "m joints"]:
    """Return the same path with no joint step above `resolution`."""
    rows = [path[:1]]
    for a, b in itertools.pairwise(path):
        count = max(1, int(np.ceil(np.abs(b - a).max() / resolution)))
        rows += [a + (b - a) * np.linspace(0, 1, count + 1)[1:-1, None], b[None]]
    return np.concatenate(rows)


def connect(
    start: Joints, goal: Joints, free: Free, arm: ArmModel, *, seed: int = 0, tries: int = TRIES
) -> JointRows | None:
    """Return a free polyline from `start` to `goal`: straight if that is free, else by RRT-Connect (Kuffner and LaValle
    2000) and shortcuts; None if none was found."""
    direct = np.stack([start, goal])
    if not (free(start) and free(goal)):
        return None
    if _clear(direct, free):
        return direct
    rng = np.random.default_rng(seed)
    trees: tuple[Tree, Tree] = ([(start, -1)], [(goal, -1)])
    for i in range(tries):
        a, b = trees[i % 2], trees[1 - i % 2]
        reach = rng.uniform(0.3, 1.0)
        middle = (start + goal) / 2
        sample = np.clip(middle + reach * rng.uniform(-2.0, 2.0, len(start)), arm.lower + 0.1, arm.upper - 0.1)
        new = _grow(a, sample, free)
        if new is None:
            continue
        while (met := _grow(b, a[new][0], free)) is not None:
            if np.abs(b[met][0] - a[new][0]).max() < 1e-9:
                first, second = (a, b) if i % 2 == 0 else (b, a)
                ends = (new, met) if i % 2 == 0 else (met, new)
                path = np.array(_branch(first, ends[0])[::-1] + _branch(second, ends[1])[1:])
                return _shortened(path, free, rng)
    return None


def _clear(path: JointRows, free: Free) -> bool:
    return all(free(joints) for joints in densified(path)[1:])


def _grow(tree: Tree, toward: Joints, free: Free) -> int | None:
    """Grow a tree towards a configuration; return the index of the new node, None if the way is not free."""
    nearest = int(np.argmin([np.linalg.norm(node - toward) for node, _ in tree]))
    step = toward - tree[nearest][0]
    if np.abs(step).max() < 1e-12:
        return None
    new = tree[nearest][0] + step * min(1.0, GROW / np.abs(step).max())
    if not _clear(np.stack([tree[nearest][0], new]), free):
        return None
    tree.append((new, nearest))
    return len(tree) - 1


def _branch(tree: Tree, node: int) -> list[Joints]:
    """Return the configurations from a node to the root."""
    rows = []
    while node >= 0:
        joints, node = tree[node]
        rows.append(joints)
    return rows


def _shortened(path: JointRows, free: Free, rng: np.random.Generator) -> Float[np.ndarray, "m joints"]:
    for _ in range(SHORTCUTS):
        if len(path) < 3:
            break
        i, j = sorted(rng.choice(len(path), 2, replace=False))
        if j - i > 1 and _clear(path[[i, j]], free):
            path = np.concatenate([path[: i + 1], path[j:]])
    return path
