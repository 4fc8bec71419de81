"""Joint paths: ways around what is in between, as polylines in joint space."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.robot.arrays import JointRows, Joints
from bt_jax.deploy.robot.model import ArmModel

__all__ = ["connect", "densified"]

RESOLUTION = 0.04  # rad of the largest joint step between two looks at clearance
GROW = 0.25  # rad by which a search tree grows at once
TRIES = 400
SHORTCUTS = 40

Free = Callable[[Joints], bool]
"""free(joints): may the arm be there?"""
Tree = list[tuple[Joints, int]]
"""Configurations, each with the index of its parent; the root's is -1."""


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
