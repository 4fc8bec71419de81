"""Trees that are run and demonstrations that are made, for the tests of learning from demonstration."""

import dataclasses
from collections.abc import Sequence

import numpy as np
import yaml

from bt_jax.behaviors import Behavior, Tree, Vocabulary, expand
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import Action, Demonstration, DemonstrationFolder, Demonstrations, Frames, Pose
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.lfd.placements import condition_of, target_of
from bt_jax.lfd.planner import plan_task
from bt_jax.mjx_env.episodes.playback import Playback, play
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import Target, Task, load_task

STACK3 = load_task("stack3")
RESTACK = load_task("restack")
FRAMES = Frames.of(STACK3)
UNSTACKING = (
    Target("GreenBox", (-1.0, -0.64, 0.75), "base_link"),
    Target("BlueBox", (-1.0, -1.36, 0.75), "base_link"),
)
STACKING = (
    Target("YellowBox", (0.0, 0.0, 0.052), "KittingBox"),
    Target("GreenBox", (0.0, 0.0, 0.1), "YellowBox"),
    Target("BlueBox", (0.0, 0.0, 0.1), "GreenBox"),
)


def demonstrations(
    task: Task, placements: Sequence[Target], *, count: int = 3, seed: int = 0, noise: float = 0.005
) -> Demonstrations:
    return demonstration_set(task, placements, count=count, rng=np.random.default_rng(seed), noise=noise)


def files_of(folder: DemonstrationFolder) -> dict[str, bytes]:
    """Everything that a folder holds, by path."""
    return {str(path.relative_to(folder.path)): path.read_bytes() for path in folder.path.rglob("*") if path.is_file()}


def in_millimetres(demonstration: str, folder: DemonstrationFolder) -> None:
    """Writes the positions of a demonstration in another unit."""
    for file in (folder.path / demonstration).iterdir():
        data = yaml.safe_load(file.read_text())
        data["vec_pos"] = {frame: [1000 * x for x in vector] for frame, vector in data["vec_pos"].items()}
        file.write_text(yaml.safe_dump(data))


def run(tree: Tree, task: Task, *, seed: int = 0, max_ticks: int = 60) -> Playback:
    """An episode at the kinematic level in a random layout of the task."""
    task = dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=max_ticks))
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    return play(semantics, Settler(task, Kinematic(task)), tree, sample_layouts(task, seed, 1))


def at(thing: str, position: Sequence[float], frame: str) -> Behavior:
    return Behavior("at", (thing, tuple(map(float, position)), frame))


def one_demonstration(task: Task, *, actions: Sequence[str] = ("pick", "place"), x: float = 0.0) -> Demonstration:
    """Actions with the same pose in all frames, `x` metres away."""
    frames = (task.kits[0].name, *task.object_names, task.robot_frame)
    return Demonstration(
        "demo1", tuple(Action(kind, {name: Pose((x, 0.0, 0.12)) for name in frames}) for kind in actions)
    )


def playbacks(tree: Tree, task: Task, *, seed: int, count: int) -> list[Playback]:
    """Episodes at the kinematic level in layouts that no plan has seen."""
    semantics, settler = LeafSemantics(task, Vocabulary.of(leaves(tree))), Settler(task, Kinematic(task))
    layouts = sample_layouts(task, seed, count)
    return [play(semantics, settler, tree, take(layouts, slice(k, k + 1))) for k in range(count)]


def asides(task: Task) -> list[Target]:
    """The places of a plan that are no targets."""
    placed = [target_of(leaf) for leaf in leaves(expand(plan_task(task))) if leaf.name == "place"]
    return [place for place in dict.fromkeys(placed) if condition_of(place) not in map(condition_of, task.targets)]
