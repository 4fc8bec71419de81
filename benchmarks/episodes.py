"""What do episodes cost? All distinct trees of one evolution, evaluated in several ways, without and with chance."""

from __future__ import annotations

import dataclasses
import operator
from pathlib import Path
from time import perf_counter, process_time
from typing import Any, NamedTuple

import jax
import numpy as np
import tyro

from benchmarks._report import report, show
from benchmarks.plain_episode import FaultyEpisode, PlainEpisode, mishaps_of
from bt_jax.behaviors import Vocabulary
from bt_jax.encoding.arrays import Trees, decode
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.faults.fates import sample_fates
from bt_jax.mjx_env.faults.variants import Variants
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take
from bt_jax.tasks import Task, load_task, with_faults
from bt_jax.tasks.faults import PRESETS, only
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

FAULTS = ("slip", "jam", "misplace")  # of the preset harsh, that the plain alternative knows, too


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Episodes per second by several ways of evaluating the distinct trees of one evolution, without and with chance."""

    task: str = "stack"
    """task to evolve for"""
    generations: int = 100
    """length of the evolution"""
    plain: int = 600
    """trees evaluated by py_trees and MuJoCo, one after another; the time is scaled up"""
    rollout: int = 256
    """trees evaluated by rollouts in MJX; the time is scaled up"""
    mjx: bool = True
    """whether to measure the MJX backend too"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    task = load_task(arguments.task)
    training = Training(task, GPConfig(method="population", generations=arguments.generations), Settings())
    trees = distinct_trees(training)
    count = trees.tokens.shape[0]
    rng = np.random.default_rng(0)
    some = rng.permutation(count)
    semantics, layouts = training.table.semantics, training.layouts
    rows = []

    def row(
        way: str, seconds: float, *, compile_seconds: float = 0.0, steps: float = float("nan"), note: str = ""
    ) -> None:
        rate = count / seconds
        rows.append(
            {
                "evaluated by": way,
                "seconds": seconds,
                "compile [s]": compile_seconds,
                "episodes/s": rate,
                "ratio to (a)": rows[0]["seconds"] / seconds if rows else 1.0,
                "physics steps": steps,
                "note": note,
            }
        )

    plain, sample = PlainEpisode(task), some[: arguments.plain]
    began = perf_counter()
    expected = np.array([plain.run(decode(trees[i], training.vocabulary), take(layouts, 0)) for i in sample])
    scale = count / len(sample)
    row(
        "(a) py_trees + MuJoCo, one by one",
        (perf_counter() - began) * scale,
        steps=plain.steps * scale,
        note=f"{len(sample)} trees, scaled up",
    )

    def table(way: str, physics) -> np.ndarray:
        TableEvaluator(semantics, physics, batch=count)(trees, layouts)  # compiles
        evaluator = TableEvaluator(semantics, physics, batch=count)
        began = perf_counter()
        result = evaluator(trees, layouts)
        seconds = perf_counter() - began
        table = evaluator.table
        row(
            way,
            seconds,
            steps=float(table.settler.steps),
            note=f"{table.num_transitions:,} transitions, {table.settler.solved:,} simulated",
        )
        began = perf_counter()
        evaluator(trees, layouts)
        row(f"{way}, filled", perf_counter() - began, steps=0.0, note="every transition known")
        return result.fitness

    c_fitness = table("(b) mujoco, transition table", make_physics(task, "mujoco"))
    agree = np.abs(c_fitness[sample] - expected) < 5
    if arguments.mjx:
        mjx = make_physics(task, "mjx")
        began = perf_counter()
        TableEvaluator(semantics, mjx, batch=count)(trees, layouts)
        first = perf_counter() - began
        mjx_fitness = table("(c) mjx, transition table", mjx)
        rows[-2]["compile [s]"] = first - rows[-2]["seconds"]
        batch = some[: arguments.rollout]
        rollout = RolloutEvaluator(semantics, mjx, batch=len(batch))
        began = perf_counter()
        rollout(trees[batch], layouts)
        first, began = perf_counter() - began, perf_counter()
        fitness = rollout(trees[batch], layouts).fitness
        seconds = perf_counter() - began
        row(
            "(d) mjx, rollout",
            seconds * count / len(batch),
            compile_seconds=first - seconds,
            note=f"{len(batch)} trees, scaled up; {np.mean(np.abs(fitness - mjx_fitness[batch]) < 5):.1%} as (c)",
        )
    table("(e) kinematic, transition table", Kinematic(task))
    with_chance = stochastic(task, training.vocabulary, trees, layouts, some, arguments)
    report(
        "episodes",
        f"{count:,} distinct trees of one evolution ({arguments.generations} generations, task {task.name})",
        rows,
        out=arguments.out,
        agreement_a_b=float(agree.mean()),
        with_chance=with_chance,
        steps_saved=float(rows[0]["physics steps"] - rows[1]["physics steps"]),
    )


class Seconds(NamedTuple):
    """A point in time, or how long something took."""

    wall: float
    processor: float  # of all threads

    @classmethod
    def now(cls) -> Seconds:
        return cls(perf_counter(), process_time())

    def since(self) -> Seconds:
        return Seconds(perf_counter() - self.wall, process_time() - self.processor)

    def times(self, factor: float) -> Seconds:
        return Seconds(self.wall * factor, self.processor * factor)


def stochastic(
    task: Task, vocabulary: Vocabulary, trees: Trees, layouts: World, some: np.ndarray, arguments: Arguments
) -> list[dict[str, Any]]:
    """The same trees where commands slip, jam and miss, every episode with a fate of its own."""
    task = with_faults(task, only(PRESETS["harsh"], *FAULTS))
    semantics, count = LeafSemantics(task, vocabulary), trees.tokens.shape[0]
    fates = sample_fates(task, 0, layouts=1, draws=count, continuous=True)
    assert fates is not None
    start = dataclasses.replace(take(layouts, np.zeros(count, int)), unseen=np.zeros((count, len(task.objects)), bool))
    which = np.arange(count, dtype=np.int32)[:, None]
    rows: list[dict[str, Any]] = []

    def row(way: str, seconds: Seconds, *, compiling: float = 0.0, steps: float | None = None, note: str = "") -> None:
        first = rows[0] if rows else {"seconds": seconds.wall, "of the processor": seconds.processor}
        rows.append(
            {
                "with chance, by": way,
                "seconds": seconds.wall,
                "of the processor": seconds.processor,
                "compile [s]": compiling,
                "episodes/s": count / seconds.wall,
                "ratio to (f)": first["seconds"] / seconds.wall,
                "ratio, processor": first["of the processor"] / seconds.processor,
                "physics steps": steps,
                "note": note,
            }
        )

    sample = some[: arguments.plain]
    classes, mishaps = mishaps_of(Variants(semantics), fates[sample])
    plain, expected = FaultyEpisode(task, classes), []
    decoded = [decode(trees[i], vocabulary) for i in sample]
    began = Seconds.now()
    for i, tree in enumerate(decoded):
        plain.mishaps = jax.tree.map(operator.itemgetter(i), mishaps)
        expected.append(plain.run(tree, take(layouts, 0)))
    scale = count / len(sample)
    note = f"{len(sample)} trees, scaled up"
    row("(f) py_trees + MuJoCo, one by one", began.since().times(scale), steps=plain.steps * scale, note=note)

    def rollout(way: str, physics: Physics, chosen: np.ndarray) -> np.ndarray:
        evaluator = RolloutEvaluator(semantics, physics, batch=len(chosen))
        times = []
        for _ in range(2):
            began = Seconds.now()
            found = evaluator(trees[chosen], start, which[chosen], fates)
            times.append(began.since())
        scale = count / len(chosen)
        note = "" if scale == 1 else f"{len(chosen)} trees, scaled up"
        row(way, times[1].times(scale), compiling=times[0].wall - times[1].wall, note=note)
        return found.values[:, 0]

    found = rollout("(g) mujoco, rollout", make_physics(task, "mujoco"), np.arange(count))
    same = np.abs(found[sample] - np.array(expected)) < 5
    rows[-1]["note"] = f"{np.mean(same):.1%} as (f)"
    if arguments.mjx:
        rollout("(h) mjx, rollout", make_physics(task, "mjx"), some[: arguments.rollout])
    rollout("(i) kinematic, rollout", Kinematic(task), np.arange(count))
    show("with chance: each episode its own", rows)
    return rows


def distinct_trees(training: Training) -> Trees:
    """All trees that an evolution measures, each once."""
    seen: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}
    measure = training.evolution.evaluate

    def remember(trees: Trees):
        tokens, sizes = np.asarray(trees.tokens)[0], np.asarray(trees.sizes)[0]
        seen.update({row.tobytes(): (row, size) for row, size in zip(tokens, sizes, strict=True)})
        return measure(trees)

    training.evolution.evaluate = remember
    for _ in training.evolution.run():
        continue
    tokens, sizes = zip(*seen.values(), strict=True)
    return Trees(np.stack(tokens), np.stack(sizes))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
