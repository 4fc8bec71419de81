"""Random trees, states and episodes that the tests share; NumPy generators, so that thousands are cheap."""

import dataclasses
import functools
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import jax
import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, Tree, check_names, gene_pool
from bt_jax.encoding.arrays import Trees, encode_all
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.pages import Pages
from bt_jax.mjx_env.episodes.table import TransitionTable
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Released, act, settled_world
from bt_jax.mjx_env.world import World, concatenate, namespace, take
from bt_jax.tasks import Task, load_task
from tests.helpers.strategies import ATOMS, SUBTASKS

MIXED = str(
    Path(__file__).with_name("mixed.yaml")
)  # a task with a flat plate, a cylinder and instances of a part, two trays
PARTS = str(Path(__file__).with_name("parts.yaml"))  # the same and more, for a gripper that needs room for its fingers


def random_tree(rng: np.random.Generator, leaves: Sequence[Behavior], num_leaves: int) -> Tree:
    """Any tree of control nodes with at least one child each, valid for evolution or not."""
    if num_leaves == 1 and rng.random() < 0.9:
        return leaves[rng.integers(len(leaves))]
    parts = int(rng.integers(1, num_leaves + 1))
    cuts = np.sort(rng.choice(num_leaves - 1, parts - 1, replace=False)) + 1
    counts = np.diff([0, *cuts, num_leaves])
    kind = Kind.SEQUENCE if rng.random() < 0.5 else Kind.FALLBACK
    return Control(kind, tuple(random_tree(rng, leaves, int(count)) for count in counts))


def random_trees(seed: int, leaves: Sequence[Behavior], count: int, *, most_leaves: int) -> list[Tree]:
    """Trees of 1 to `most_leaves` leaves; the first is a single leaf."""
    rng = np.random.default_rng(seed)
    return [leaves[0], *(random_tree(rng, leaves, int(rng.integers(1, most_leaves + 1))) for _ in range(count - 1))]


def mixed_trees(semantics: LeafSemantics, seed: int, count: int, num_nodes: int) -> Trees:
    """Half of them from genes alone, which act; half from all leaves, which often fail."""
    leaves = semantics.vocabulary.leaves
    genes = [leaf for leaf in leaves if leaf.name in ("move", "carry")]
    found = random_trees(seed, genes, count, most_leaves=6) + random_trees(seed + 1, leaves, count, most_leaves=8)
    found = [tree for tree in found if len(prefix(tree)) <= num_nodes]
    rng = np.random.default_rng(seed)
    return encode_all([found[i] for i in rng.permutation(len(found))[:count]], semantics.vocabulary, num_nodes)


@functools.cache
def semantics_of(task_name: str, *, atoms: bool = True, subgoal_reward: str | None = None) -> LeafSemantics:
    """The gene pool of a task, and with `atoms` single conditions and actions as well; with the task's rule for subgoals,
    or another."""
    task = load_task(task_name)
    task = dataclasses.replace(task, subgoal_reward=subgoal_reward or task.subgoal_reward)
    vocabulary = gene_pool(task)
    if atoms:
        vocabulary = vocabulary.extended(filter(functools.partial(_is_known, task), [*ATOMS, *SUBTASKS]))
        vocabulary = vocabulary.extended(_atoms_of_parts(task))
    return LeafSemantics(task, vocabulary)


def _is_known(task: Task, leaf: Behavior) -> bool:
    try:
        check_names(leaf, task)
    except UserError:
        return False
    return True


def _atoms_of_parts(task: Task) -> Iterator[Behavior]:
    """Conditions and picks of parts and of their instances, and the part at its targets and on one of its instances."""
    for part in (name for name in task.kinds if name not in task.object_names):
        for name in (part, task.instances[part][-1]):
            yield from (Behavior(kind, (name,)) for kind in ("holding", "reachable", "clear", "pick"))
        for target in task.targets:
            if target.object == part:
                place = (part, target.position, target.frame, *([] if target.turn is None else [target.turn]))
                yield from (Behavior("at", place), Behavior("place", place))
        yield Behavior("move", (part, (0.0, 0.0, 0.02), task.instances[part][0]))


def walk(semantics: LeafSemantics, physics: Physics, *, seed: int, count: int, steps: int) -> tuple[World, Released]:
    """`count` episodes of `steps` random possible commands: all states on the way, and all releases in mid-command."""
    rng = np.random.default_rng(seed)
    task = semantics.task
    world = sample_layouts(task, seed, count)
    worlds, releases = [world], []
    for _ in range(steps):
        released = act(semantics, world, random_commands(semantics, world, rng))
        settled = physics.settle(released.world.kits, released.poses, released.present & (released.box >= 0)[:, None])
        world = settled_world(task, released, np.asarray(settled.poses))
        worlds.append(world)
        releases.append(released)
    return concatenate(worlds), _join(releases)


def random_commands(semantics: LeafSemantics, world: World, rng: np.random.Generator) -> np.ndarray:
    """For each state a command that could run there; opening the gripper where nothing could."""
    statuses = semantics._atom_outcomes(world)[:, len(semantics.conditions) :] & 3
    weights = (statuses == 2) * rng.random(statuses.shape)
    return weights.argmax(axis=1).astype(np.int32)


def kinematic_walk(
    task_name: str, *, seed: int, count: int = 40, steps: int = 10, subgoal_reward: str | None = None
) -> tuple[LeafSemantics, World, Released]:
    semantics = semantics_of(task_name, subgoal_reward=subgoal_reward)
    return semantics, *walk(semantics, Kinematic(semantics.task), seed=seed, count=count, steps=steps)


def one(world: World, index: int) -> World:
    return take(world, slice(index, index + 1))


def _join(releases: list[Released]) -> Released:
    return Released(
        world=concatenate([release.world for release in releases]),
        poses=np.concatenate([release.poses for release in releases]),
        present=np.concatenate([release.present for release in releases]),
        box=np.concatenate([release.box for release in releases]),
    )


_followed = jax.jit(Pages.at)


def followed(table: TransitionTable, states: np.ndarray, commands: np.ndarray) -> np.ndarray:
    """Where commands lead in states, as far as the table knows."""
    return np.asarray(_followed(table.known.following, states, commands))


def command(module: str, *arguments: object, **options) -> subprocess.CompletedProcess:
    """Runs one of the package's commands to its end."""
    words = [sys.executable, "-m", module, *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, timeout=300, **options)


def train_command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "bt_jax.train", *map(str, arguments)]


def train(*arguments: object, **options) -> subprocess.CompletedProcess:
    """Runs the command line of training to its end."""
    return command("bt_jax.train", *arguments, **options)


def sized(task: Task) -> np.ndarray:
    return np.array([box.edge for box in task.objects], np.float32)


def assert_same(a, b) -> None:
    """Two pytrees with equal arrays."""
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(x, y)


@dataclasses.dataclass(frozen=True)
class SometimesBroken(Kinematic):
    """Physics that diverges if an object is let go in the kit; NumPy or JAX."""

    def settle(self, kits, poses, present):
        xp, settled = namespace(poses), super().settle(kits, poses, present)
        near = xp.abs(poses[..., :2] - kits[:, :1, :2]).max(axis=-1) < np.float32(0.19)
        bad = (near & present).any(axis=1)
        poses = xp.where(bad[:, None, None], np.float32(np.nan), settled.poses)
        return dataclasses.replace(settled, poses=poses, ok=~bad)
