"""What do our departures from the paper's rules change? Trees in the scalar reference, with one rule changed at a time.

python -m benchmarks.departures
"""

from __future__ import annotations

import dataclasses
import zlib
from collections.abc import Iterator
from pathlib import Path

import jax
import numpy as np
import tyro
from py_trees.common import Status as PyStatus

from benchmarks._report import report
from benchmarks.plain_episode import PlainEpisode
from bt_jax.behaviors import Behavior, Tree, gene_pool
from bt_jax.behaviors.geometry import rests_on
from bt_jax.behaviors.pose import Pose
from bt_jax.encoding.arrays import decode, encode_all
from bt_jax.encoding.formats.text import one_line
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.random_trees import random_trees
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import LIFT
from bt_jax.mjx_env.world import World, take
from bt_jax.tasks import Task, load_task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

SIZES = (4, 6, 9, 13)  # nodes of random trees, in equal shares
SAME = 5.0  # fitness: how far two simulations of one episode may be apart; a node costs 10


class GripperWithinTick(PlainEpisode):
    """open_gripper and close_gripper take no tick: they act at once and succeed."""

    def status(self, leaf: Behavior) -> PyStatus:
        status = super().status(leaf)
        if status == PyStatus.RUNNING and leaf.name in ("open_gripper", "close_gripper"):
            self.pending = None
            self.act(leaf)
            return PyStatus.SUCCESS
        return status


class AtWhileHeld(PlainEpisode):
    """`at` is true also while the object hangs in the gripper at that place."""

    def at(self, leaf: Behavior) -> bool:
        return self.is_near(leaf)


class PickCarriesAll(PlainEpisode):
    """`pick` needs no clear object: what stands on it is carried, too."""

    def is_clear(self, name: str) -> bool:
        return True

    def act(self, action: Behavior) -> None:
        if action.name not in ("pick", "place"):
            return super().act(action)
        load, before = list(self.load(action.object)), self.position(action.object).copy()
        if action.name == "pick":
            shift = np.array([0, 0, LIFT * self.sizes[action.object]])
            self.held, self.gripper_open = action.object, False
        else:
            shift = self.release_position(action) - before
            self.held, self.gripper_open = None, True
        for name in (action.object, *load):
            self.body_qpos(name)[:3] += shift
        return self.settle()

    def load(self, name: str) -> Iterator[str]:
        """Yield the boxes that stand on a box, and on those, from the bottom up."""
        for other in self.task.object_names:
            upper, lower = ((self.task.thing(one), Pose(tuple(self.position(one)))) for one in (other, name))
            if other != name and rests_on(*upper, *lower):
                yield other
                yield from self.load(other)


class Occupied(PlainEpisode):
    """Ours, and counts the boxes that are put where another one is: they are released on top of it."""

    occupied = 0

    def act(self, action: Behavior) -> None:
        if action.name == "place":
            goal, size = self.in_world(action.frame, action.position), self.sizes[action.object]
            self.occupied += any(
                (np.abs(self.position(other) - goal) < (size + self.sizes[other]) / 2 - 0.002).all()
                for other in self.task.object_names
                if other != action.object
            )
        super().act(action)


RULES: dict[str, type[PlainEpisode]] = {
    "gripper actions take no tick": GripperWithinTick,
    "at is true of a held object": AtWhileHeld,
    "pick carries what stands on the object": PickCarriesAll,
}


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Trees of three tasks, half of them random and half evolved, with our rules and with one of the paper's at a time."""

    tasks: tuple[str, ...] = ("stack", "stack3", "pyramid")
    """tasks without subgoals"""
    trees: int = 50
    """trees of each task"""
    layouts: int = 10
    """layouts in which each tree runs"""
    seed: int = 0
    """of trees and layouts"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    found: dict[str, list[np.ndarray]] = {}
    agree, occupied, evolved, examples = [], [], [], {}
    for name in arguments.tasks:
        task = load_task(name)
        random, learnt = _random(task, arguments), _evolved(task, arguments)
        trees = [*random, *learnt]
        evolved += [False] * len(random) + [True] * len(learnt)
        layouts = sample_layouts(task, [arguments.seed, 17], arguments.layouts)
        counting = Occupied(task)
        ours = np.empty((len(trees), arguments.layouts))
        for i, tree in enumerate(trees):
            before = counting.occupied
            ours[i] = [counting.run(tree, take(layouts, k)) for k in range(arguments.layouts)]
            occupied.append(counting.occupied > before)
        agree.append(np.abs(ours - _product(task, trees, layouts)) < SAME)
        found.setdefault("ours", []).append(ours)
        for rule, episode in RULES.items():
            plain = episode(task)
            values = np.array([[plain.run(tree, take(layouts, k)) for k in range(len(ours[0]))] for tree in trees])
            found.setdefault(rule, []).append(values)
            far = np.abs(values - ours).max(axis=1)
            if far.max() > SAME:
                i = int(far.argmax())
                fitness = {"ours": ours[i].mean(), "changed": values[i].mean()}
                examples.setdefault(rule, []).append({"task": name, "tree": one_line(trees[i]), **fitness})
    values = {rule: np.concatenate(rows) for rule, rows in found.items()}
    rows = [_row(rule, values[rule], values["ours"], np.array(evolved)) for rule in RULES]
    report(
        "departures",
        f"{len(evolved)} trees in {arguments.layouts} layouts, one rule changed",
        rows,
        out=arguments.out,
        reference_as_product=float(np.concatenate(agree).mean()),
        trees_that_put_a_box_where_another_is=int(np.sum(occupied)),
        examples=examples,
    )


def _row(rule: str, changed: np.ndarray, ours: np.ndarray, evolved: np.ndarray) -> dict:
    """What one rule changes; `changed` and `ours` are the fitness [trees, layouts]."""
    difference = changed - ours
    differs = np.abs(difference) > SAME
    return {
        "rule": rule,
        "trees": len(ours),
        "trees that change": int(differs.any(axis=1).sum()),
        "random": int(differs[~evolved].any(axis=1).sum()),
        "evolved": int(differs[evolved].any(axis=1).sum()),
        "episodes that change": float(differs.mean()),
        "mean difference": float(difference.mean()),
        "of those that change": float(difference[differs].mean()) if differs.any() else 0.0,
        "better": int((difference.mean(axis=1) > SAME).sum()),
        "worse": int((difference.mean(axis=1) < -SAME).sum()),
    }


def _random(task: Task, arguments: Arguments) -> list[Tree]:
    """Half of the trees of a task: random ones of four sizes."""
    pool, trees = gene_pool(task), []
    count = arguments.trees // 2
    for nodes in SIZES:
        batch = random_trees(
            jax.random.key(zlib.crc32(f"{task.name} {nodes} {arguments.seed}".encode())),
            Alphabet.of(pool),
            count=count,
            num_nodes=64,
            nodes=nodes,
        )
        trees.append([decode(batch[k], pool) for k in range(count)])
    return [trees[k % len(SIZES)][k] for k in range(count)]


def _evolved(task: Task, arguments: Arguments) -> list[Tree]:
    """The other half: of each of as many evolutions, one tree of the population after 40 generations."""
    count = arguments.trees - arguments.trees // 2
    training = Training(
        task, GPConfig(method="population", generations=40, runs=count, seed=arguments.seed), Settings()
    )
    rng = np.random.default_rng(arguments.seed)
    *_, state = training.evolution.run()
    trees = jax.device_get(state.population.trees)
    chosen = rng.integers(trees.tokens.shape[1], size=count)
    one_each = jax.tree.map(lambda leaf: leaf[np.arange(count), chosen], trees)
    return [decode(one_each[run], training.vocabulary) for run in range(count)]


def _product(task: Task, trees: list[Tree], layouts: World) -> np.ndarray:
    """The fitness of trees in layouts, [trees, layouts], as the package evaluates them."""
    semantics = LeafSemantics(task, gene_pool(task))
    evaluate = TableEvaluator(semantics, MujocoPhysics(task), batch=len(trees))
    return evaluate(encode_all(trees, semantics.vocabulary, MAX_NODES), layouts).values


if __name__ == "__main__":
    main(tyro.cli(Arguments))
