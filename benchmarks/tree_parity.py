"""Does it matter which physics backend evaluates a tree? Random trees through C MuJoCo and MJX, every difference traced."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from time import perf_counter

import jax
import numpy as np
import tyro
from rich.console import Console

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import decode
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.mjx_env.episodes.playback import Playback, play
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_task

NEAR = 0.002  # metres


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Random trees through both physics backends."""

    trees: int = 1000
    """number of trees"""
    task: str = "stack3"
    """task whose gene pool and layouts they use"""
    nodes: tuple[int, ...] = (4, 6, 9, 13)
    """sizes of the trees, in equal shares"""
    layouts: int = 10
    """layouts, in turn"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    task = load_task(arguments.task)
    vocabulary = gene_pool(task)
    trees = []
    for i, nodes in enumerate(arguments.nodes):
        count = -(-arguments.trees // len(arguments.nodes))
        batch = random_trees(jax.random.key(i), Alphabet.of(vocabulary), count=count, num_nodes=64, nodes=nodes)
        trees += [decode(tree, vocabulary) for tree in map(batch.__getitem__, range(count))]
    trees = trees[: arguments.trees]
    semantics = LeafSemantics(task, vocabulary)
    layouts = sample_layouts(task, 0, arguments.layouts)
    played, seconds = {}, {}
    for backend in ("mujoco", "mjx"):
        settler, began = Settler(task, make_physics(task, backend)), perf_counter()
        played[backend] = [
            play(semantics, settler, tree, take(layouts, slice(i % arguments.layouts, i % arguments.layouts + 1)))
            for i, tree in enumerate(trees)
        ]
        seconds[backend] = perf_counter() - began
    near, same, differences = 0, 0, []
    for tree, c, mjx in zip(trees, played["mujoco"], played["mjx"], strict=True):
        apart = np.linalg.norm(c.final.poses[0, :, :3] - mjx.final.poses[0, :, :3], axis=-1).max()
        near += apart <= NEAR
        same += (c.ending, c.solved) == (mjx.ending, mjx.solved)
        if apart > NEAR or c.ending != mjx.ending:
            differences.append({"tree": one_line(tree), "apart [m]": float(apart), **first_difference(c, mjx)})
    rows = [
        {
            "task": task.name,
            "trees": len(trees),
            "ticks": sum(len(c.ticks) for c in played["mujoco"]),
            "within 2 mm": near / len(trees),
            "same verdict": same / len(trees),
            "mujoco [s]": seconds["mujoco"],
            "mjx, compiling too [s]": seconds["mjx"],
        }
    ]
    for difference in differences:
        Console().print(difference)
    report("tree_parity", "mjx against mujoco", rows, out=arguments.out, differences=differences)


def first_difference(c: Playback, mjx: Playback) -> dict:
    """The first tick after which the worlds are apart: what was done, and where each engine left each box."""
    for number, (ours, theirs) in enumerate(zip(c.ticks, mjx.ticks, strict=False)):
        apart = np.linalg.norm(ours.after.poses[0, :, :3] - theirs.after.poses[0, :, :3], axis=-1)
        if apart.max() > NEAR or ours.command != theirs.command:
            return {
                "tick": number,
                "command": str(ours.command),
                "before": np.round(ours.before.poses[0], 4).tolist(),
                "mujoco": np.round(ours.after.poses[0], 4).tolist(),
                "mjx": np.round(theirs.after.poses[0], 4).tolist(),
            }
    return {"tick": None}


if __name__ == "__main__":
    main(tyro.cli(Arguments))
