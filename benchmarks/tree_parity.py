"""Does it matter which physics evaluates a tree? Random trees through C MuJoCo, MJX and the kinematic level; every
difference between the engines is traced."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path
from time import perf_counter

import jax
import numpy as np
import tyro
from rich.console import Console

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Tree, gene_pool
from bt_jax.encoding.arrays import decode
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.mjx_env.episodes.fitness import target_misses
from bt_jax.mjx_env.episodes.playback import EpisodeState, Tick
from bt_jax.mjx_env.episodes.rules import Ending, is_solved
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Physics, Settled
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take
from bt_jax.tasks import load_task

NEAR = 0.002  # metres


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Random trees through both engines and the kinematic level."""

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
    levels = {"mujoco": make_physics(task, "mujoco"), "mjx": make_physics(task, "mjx"), "kinematic": Kinematic(task)}
    played, seconds = {}, {}
    for name, physics in levels.items():
        began = perf_counter()
        played[name] = play_all(semantics, physics, trees, layouts)
        seconds[name] = perf_counter() - began
    near, same, differences = 0, 0, []
    for tree, c, mjx in zip(trees, played["mujoco"], played["mjx"], strict=True):
        apart = np.linalg.norm(c.state.world.poses[0, :, :3] - mjx.state.world.poses[0, :, :3], axis=-1).max()
        near += apart <= NEAR
        same += c.verdict == mjx.verdict
        if apart > NEAR or c.verdict != mjx.verdict:
            differences.append({"tree": one_line(tree), "apart [m]": float(apart), **first_difference(c, mjx)})
    pairs = zip(played["mujoco"], played["kinematic"], strict=True)
    rows = [
        {
            "task": task.name,
            "trees": len(trees),
            "ticks": sum(len(c.ticks) for c in played["mujoco"]),
            "within 2 mm": near / len(trees),
            "same verdict": same / len(trees),
            "kinematic, same verdict": sum(c.verdict == other.verdict for c, other in pairs) / len(trees),
            "mujoco [s]": seconds["mujoco"],
            "mjx, compiling too [s]": seconds["mjx"],
        }
    ]
    for difference in differences:
        Console().print(difference)
    report("tree_parity", "mjx against mujoco", rows, out=arguments.out, differences=differences)


@dataclasses.dataclass
class Played:
    """One episode."""

    state: EpisodeState
    ticks: list[Tick] = dataclasses.field(default_factory=list)

    @property
    def verdict(self) -> tuple[Ending, bool]:
        """How it ended, and whether it solved the task."""
        ending, final = self.state.ending, self.state.world
        return ending, bool(
            is_solved(np.array([ending], np.int8), target_misses(self.state.semantics.task, final).met)[0]
        )


class Pending(Exception):
    """A problem has been noted, and is to be solved with others."""


@dataclasses.dataclass
class Noting:
    """A physics that notes the problems that it has not solved yet, so that those of many episodes are solved together."""

    physics: Physics
    name: str = "noting"
    description: str = "a physics that is asked for many problems at a time"
    solved: dict[bytes, Settled] = dataclasses.field(default_factory=dict)
    noted: dict[bytes, tuple[np.ndarray, ...]] = dataclasses.field(default_factory=dict)

    def settle(self, kits: np.ndarray, poses: np.ndarray, present: np.ndarray) -> Settled:
        """See `Physics.settle`. Raise Pending where a problem is new."""
        problems = list(zip(kits, poses, present, strict=True))
        names = [b"".join(part.tobytes() for part in problem) for problem in problems]
        new = {name: problem for name, problem in zip(names, problems, strict=True) if name not in self.solved}
        if new:
            self.noted |= new
            raise Pending
        return jax.tree.map(lambda *each: np.stack(each), *[self.solved[name] for name in names])

    def solve(self) -> None:
        """Solve what was noted."""
        batch = [np.stack(field) for field in zip(*self.noted.values(), strict=True)]
        settled = jax.tree.map(np.asarray, self.physics.settle(*batch))
        for row, name in enumerate(self.noted):
            self.solved[name] = jax.tree.map(lambda leaf, row=row: leaf[row], settled)
        self.noted = {}


def play_all(semantics: LeafSemantics, physics: Physics, trees: list[Tree], layouts: World) -> list[Played]:
    """Play each tree in one of the layouts, all of them side by side."""
    noting = Noting(physics)
    settler, count = Settler(semantics.task, noting), layouts.held.shape[0]
    starts = [take(layouts, slice(i % count, i % count + 1)) for i in range(len(trees))]
    played = [Played(EpisodeState(semantics, settler, tree, start)) for tree, start in zip(trees, starts, strict=True)]
    while going := [episode for episode in played if episode.state.ending == Ending.OPEN]:
        for episode in going:
            with contextlib.suppress(Pending):
                tick, episode.state = episode.state.tick()
                episode.ticks.append(tick)
        if noting.noted:
            noting.solve()
    return played


def first_difference(c: Played, mjx: Played) -> dict:
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
