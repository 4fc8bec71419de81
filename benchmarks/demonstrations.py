"""How often are frames, goals and orders recognized, by the number of demonstrations? Does the learnt tree work? And are two
situations told apart?

Random sets of synthetic demonstrations: 2 to 6 boxes, random layouts, places in the kit, on boxes and at table edges, some
boxes put aside first, every other set in varying orders, noise of 5 to 10 mm along each axis. Strictly right is the frame
that was meant, leniently right also one that moved with it in all demonstrations of the set: they differ by noise only.

With `--kits`, 2 to 6 objects of several shapes in random turns, some of them instances of a part, that go into the slots of
two trays, beside these and on each other. And scripted demonstrations of packaged tasks: does the learnt tree solve them?"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import tyro
from rich.progress import track

from benchmarks._report import report, show
from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree, Vocabulary
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import Demonstrations, Frames, learn
from bt_jax.lfd.evaluation.assessment import (
    Example,
    assess,
    kit_example,
    random_example,
    situations_example,
    tells_apart,
)
from bt_jax.lfd.evaluation.synthetic import on_one_table, with_boxes
from bt_jax.lfd.evaluation.synthetic_kits import random_kit
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import load_task
from bt_jax.teaching.script import parse_script, record
from bt_jax.training.levels import make_level
from bt_jax.training.settings import UNSEEN, Settings

PACKAGED = ("kit4", "kit6", "kit9", "bolts", "fixture")
TURN_NOISE = 2.0  # degrees by which a turn is missed


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Rates of recognition."""

    sets: int = 500
    """random sets for each number of demonstrations"""
    counts: tuple[int, ...] = (3, 4, 5, 6, 8, 10)
    """numbers of demonstrations"""
    seed: int = 0
    """of the random sets"""
    kits: bool = False
    """kits of several shapes instead of boxes, and the packaged tasks"""
    layouts: int = 100
    """unseen layouts for the trees of packaged tasks"""
    out: Path | None = None
    """where to write the JSON file"""


def main(arguments: Arguments) -> None:
    if arguments.kits:
        main_kits(arguments)
        return
    rows, errors = [], {}
    for count in arguments.counts:
        row, failed = measured(count, arguments)
        row["both of two situations"], unclear = situations(count, arguments)
        rows.append(row)
        errors[str(count)] = failed + unclear
    report("demonstrations", "Recognized (%)", rows, out=arguments.out, errors=errors)


def main_kits(arguments: Arguments) -> None:
    rows, errors = [], {}
    for count in arguments.counts:
        row, errors[str(count)] = measured(count, arguments, kit_of)
        rows.append(row)
    tasks = [packaged(name, arguments) for name in PACKAGED]
    show("Packaged tasks, learnt from 3 scripted demonstrations", tasks)
    report("demonstrations_kits", "Recognized (%)", rows, out=arguments.out, errors=errors, packaged=tasks)


def boxes_of(seed: int, count: int, arguments: Arguments) -> Example:
    rng = np.random.default_rng([arguments.seed, seed])
    task = with_boxes(load_task("stack"), int(rng.integers(2, 7)))
    noise = rng.uniform(0.005, 0.01)
    return random_example(task, seed=[arguments.seed, seed], count=count, noise=noise, reorder=bool(seed % 2))


def kit_of(seed: int, count: int, arguments: Arguments) -> Example:
    rng = np.random.default_rng([arguments.seed, seed])
    task = random_kit(load_task("kit4"), objects=int(rng.integers(2, 7)), rng=rng)
    noise = rng.uniform(0.003, 0.006)
    return kit_example(
        task, seed=[arguments.seed, seed], count=count, noise=noise, turn_noise=TURN_NOISE, reorder=bool(seed % 2)
    )


def packaged(name: str, arguments: Arguments) -> dict[str, Any]:
    """How many unseen layouts of a packaged task the tree solves that is learnt from scripted demonstrations, at the level
    `physics`."""
    task = load_task(name)
    script = "; ".join(f"pick {target.object}; to {target.slot}; release" for target in task.targets)
    shown = record(task, MujocoPhysics(task), parse_script(script), noise=0.002)
    lesson = learn(Demonstrations(Frames.of(task), tuple(shown)), task)
    semantics = LeafSemantics(task, Vocabulary.of(leaves(lesson.tree)))
    settings = Settings(test_layouts=arguments.layouts)
    layouts = sample_layouts(task, [UNSEEN, 0], arguments.layouts)
    solved = survey(semantics, make_level(task, settings), lesson.tree, layouts).solved
    return {
        "task": name,
        "targets": len(task.targets),
        "right": len(set(lesson.targets) & set(task.targets)),
        "layouts": arguments.layouts,
        "solved": int(solved.sum()),
    }


def measured(
    count: int, arguments: Arguments, example_of: Callable[[int, int, Arguments], Example] = boxes_of
) -> tuple[dict[str, Any], list[str]]:
    found, works, failed, seconds = [], [], [], 0.0
    for seed in track(range(arguments.sets), description=f"{count} demonstrations"):
        example = example_of(seed, count, arguments)
        task = example.task
        began = perf_counter()
        try:
            lesson = learn(example.demonstrations, task)
        except UserError as error:
            failed.append(f"set {seed}: {error}")
            continue
        finally:
            seconds += perf_counter() - began
        result = assess(lesson, example)
        found.append(result)
        works.append(reaches_the_truth(lesson.tree, example))
        right = min(result.lenient, result.turns, result.slots) == result.placements
        if not (right and result.goal and result.order and works[-1]):
            failed.append(f"set {seed}: {result}, works {works[-1]}")
    total = sum(one.placements for one in found)

    def percent(hits: float, of: int) -> float:
        return 100 * hits / of

    row = {
        "demonstrations": count,
        "sets": arguments.sets,
        "placements": total,
        "frame meant": percent(sum(one.strict for one in found), total),
        "or one moving with it": percent(sum(one.lenient for one in found), total),
        "goal": percent(sum(one.goal for one in found), arguments.sets),
        "order": percent(sum(one.order for one in found), arguments.sets),
        "goal and order": percent(sum(one.goal and one.order for one in found), arguments.sets),
        "tree works": percent(sum(works), arguments.sets),
        "ms each": 1000 * seconds / arguments.sets,
    }
    if arguments.kits:
        row |= {key: percent(sum(getattr(one, key) for one in found), total) for key in ("turns", "slots")}
    return row, failed


def situations(count: int, arguments: Arguments) -> tuple[float, list[str]]:
    """The share of sets in which both places of one box are found, with `count` demonstrations of each [%]."""
    failed = []
    for seed in track(range(arguments.sets), description=f"{count} + {count} demonstrations"):
        rng = np.random.default_rng([arguments.seed, seed])
        task = with_boxes(load_task("stack"), int(rng.integers(3, 7)))
        task = on_one_table(task) if seed % 2 else task
        example = situations_example(task, seed=[arguments.seed, seed], count=count, noise=0.005)
        try:
            found = tells_apart(learn(example.demonstrations, task), example)
        except UserError as error:
            failed.append(f"situations {seed}: {error}")
            continue
        if not found:
            failed.append(f"situations {seed}: {example.shown}")
    return 100 * (1 - len(failed) / arguments.sets), failed


def reaches_the_truth(tree: Tree, example: Example) -> bool:
    """Whether the tree, run in the layout of the first demonstration at the kinematic level, brings every box to where the
    demonstrator meant it."""
    rules = dataclasses.replace(example.task.episode, max_ticks=4 * len(example.shown[0]) + 4)
    task = dataclasses.replace(example.task, targets=example.final, episode=rules)
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    played = play(semantics, Settler(task, Kinematic(task)), tree, layout_of(example))
    return played.ending == Ending.SUCCESS and bool(played.misses.met.all())


def layout_of(example: Example) -> World:
    """Where the first demonstration begins, a batch of one state."""
    task = example.task
    first = example.exact.demonstrations[0].actions[0]
    seen = {name: first.pose(name, task.robot_frame) for name in first.poses}
    centre = {name: pose.position + np.array(task.robot_position) for name, pose in seen.items()}
    poses = np.array([[*centre[name], *seen[name].quaternion] for name in task.object_names], np.float32)
    return World(
        kits=np.array([[centre[name] for name in task.kit_names]], np.float32),
        poses=poses[None],
        held=np.full(1, -1, np.int8),
        gripper_open=np.ones(1, bool),
        reached=np.zeros((1, len(task.subgoals)), bool),
    )


if __name__ == "__main__":
    main(tyro.cli(Arguments))
