"""Does it matter which physics evaluates a tree? Random trees through C MuJoCo, MJX and the kinematic level; every
difference between the engines is traced."""

from __future__ import annotations

import contextlib
import dataclasses
import math
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
from bt_jax.mjx_env.skills import act
from bt_jax.mjx_env.world import World, take
from bt_jax.tasks import Task, load_task

NEAR = 0.002  # metres
JITTER = 1e-5  # metres; a release that ends elsewhere with so little is sensitive


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Random trees through both engines and the kinematic level."""

    trees: int = 1000
    """number of trees for each task"""
    tasks: tuple[str, ...] = ("stack3",)
    """tasks whose gene pools and layouts they use"""
    nodes: tuple[int, ...] = (4, 6, 9, 13)
    """sizes of the trees, in equal shares"""
    layouts: int = 10
    """layouts, in turn"""
    mjx: bool = True
    """whether MJX plays them too, which takes long where there are many objects"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    rows, differences = [], []
    for name in arguments.tasks:
        row, found = compare(load_task(name), arguments)
        Console().print(row)
        rows.append(row)
        differences += found
    report("tree_parity", "mjx against mujoco", rows, out=arguments.out, differences=differences)


def compare(task: Task, arguments: Arguments) -> tuple[dict, list[dict]]:
    """How often the levels agree in a task, and each difference between the two engines."""
    vocabulary = gene_pool(task)
    trees = []
    for i, nodes in enumerate(arguments.nodes):
        count = -(-arguments.trees // len(arguments.nodes))
        batch = random_trees(jax.random.key(i), Alphabet.of(vocabulary), count=count, num_nodes=64, nodes=nodes)
        trees += [decode(tree, vocabulary) for tree in map(batch.__getitem__, range(count))]
    trees = trees[: arguments.trees]
    semantics = LeafSemantics(task, vocabulary)
    layouts = sample_layouts(task, 0, arguments.layouts)
    levels = {"mujoco": make_physics(task, "mujoco"), "kinematic": Kinematic(task)}
    if arguments.mjx:
        levels["mjx"] = make_physics(task, "mjx")
    played, seconds = {}, {}
    for name, physics in levels.items():
        began = perf_counter()
        played[name] = play_all(semantics, physics, trees, layouts)
        seconds[name] = perf_counter() - began
    near, same, differences = 0, 0, []
    for tree, c, mjx in zip(trees, played["mujoco"], played.get("mjx", ()), strict=False):
        apart = distances(c.state.world, mjx.state.world).max()
        near += int(apart <= NEAR)
        same += c.verdict == mjx.verdict
        if apart > NEAR or c.verdict != mjx.verdict:
            found = first_difference(semantics, levels["mujoco"], c, mjx)
            differences.append(
                {"task": task.name, "tree": one_line(tree), "apart [m]": round(float(apart), 5), **found}
            )
    pairs = zip(played["mujoco"], played["kinematic"], strict=True)
    row = {
        "task": task.name,
        "objects": len(task.objects),
        "trees": len(trees),
        "ticks": sum(len(c.ticks) for c in played["mujoco"]),
        "within 2 mm": near / len(trees) if arguments.mjx else math.nan,
        "same verdict": same / len(trees) if arguments.mjx else math.nan,
        "different": len(differences) if arguments.mjx else math.nan,
        "of these sensitive": sum(each["sensitive"] for each in differences) if arguments.mjx else math.nan,
        "kinematic, same verdict": sum(c.verdict == other.verdict for c, other in pairs) / len(trees),
        "mujoco [s]": seconds["mujoco"],
        "mjx, compiling too [s]": seconds.get("mjx", math.nan),
    }
    return row, differences


def distances(a: World, b: World) -> np.ndarray:
    """How far each object is from where it is in the other state, metres."""
    return np.linalg.norm(a.poses[0, :, :3] - b.poses[0, :, :3], axis=-1)


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


def first_difference(semantics: LeafSemantics, engine: Physics, c: Played, mjx: Played) -> dict:
    """The first tick after which the worlds are apart: what was done, where each engine left the objects that are apart, and
    whether the C engine itself leaves anything elsewhere if all start 0.01 mm away (`sensitive`)."""
    for number, (ours, theirs) in enumerate(zip(c.ticks, mjx.ticks, strict=False)):
        apart = distances(ours.after, theirs.after)
        if apart.max() > NEAR or ours.command != theirs.command:
            names = semantics.task.object_names
            return {
                "tick": number,
                "command": str(ours.command),
                "sensitive": ours.command is not None and is_sensitive(semantics, engine, ours),
                "objects": {
                    names[i]: {
                        "before": rounded(ours.before, i),
                        "mujoco": rounded(ours.after, i),
                        "mjx": rounded(theirs.after, i),
                    }
                    for i in np.flatnonzero(apart > NEAR)
                },
            }
    return {"tick": None, "sensitive": False}


def rounded(world: World, i: int) -> list[float]:
    return world.poses[0, i].astype(float).round(4).tolist()


def is_sensitive(semantics: LeafSemantics, engine: Physics, tick: Tick) -> bool:
    """Whether what a command lets go ends more than NEAR elsewhere if all objects start JITTER away."""
    number = semantics.commands.index(tick.command)
    released = act(semantics, tick.before, np.array([number], np.int32))
    shaken = np.repeat(released.poses, 9, axis=0)
    shaken[1:, :, :2] += np.random.default_rng(0).normal(size=shaken[1:, :, :2].shape) * JITTER
    kits, present = (np.repeat(values, 9, axis=0) for values in (released.world.kits, released.present))
    ends = np.asarray(engine.settle(kits, shaken, present).poses)[..., :3]
    away = np.linalg.norm(ends[1:] - ends[:1], axis=-1)
    return bool((away * present[1:] > NEAR).any())


if __name__ == "__main__":
    main(tyro.cli(Arguments))
