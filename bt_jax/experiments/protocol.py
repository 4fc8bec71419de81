"""The experiments, and how one is run.

All runs of a variant are evolved side by side; run r has the layout of seed + r, the same in all variants.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Literal

import numpy as np
from jaxtyping import Float32

from bt_jax._util.startup import CompileClock
from bt_jax.behaviors import Behavior, Tree
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import Generation, State
from bt_jax.lfd import Demonstrations, Frames, Lesson, learn, plan_task
from bt_jax.tasks import Task, load_task
from bt_jax.teaching.script import parse_script, record
from bt_jax.training.levels import make_level
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

__all__ = ["EXPERIMENTS", "Experiment", "Variant", "VariantResult", "perform"]

Variant = Literal["with_demonstration", "gp_only", "achievements"]  # the first two are published
NOISE = 0.003  # with which the scripted person misses each place, along each axis, metres


@dataclasses.dataclass(frozen=True)
class Experiment:
    """One experiment. Evolution first works on `before`, if there is one, and from generation `change_at` on `task`, with
    the demonstration or without.

    `script` is what is demonstrated `demonstrations` times, once the first `reached` targets of `task` have been reached.
    By `use`, its places become genes and its tree the baseline, or all of it one gene that is done once its subgoal, the
    task's own, has been reached. `wanted` is the fitness by which a run counts as solved.
    """

    number: int
    title: str
    task: str
    config: GPConfig
    script: str
    demonstrations: int
    use: Literal["genes", "subgoal"]
    wanted: float
    before: str | None = None
    change_at: int = 0
    reached: int = 0
    baseline_index: int | None = None


EXPERIMENTS = (
    Experiment(
        number=1,
        title="a third box on the stack, added to the task at generation 50",
        before="stack",
        task="stack3",
        config=GPConfig(method="population", generations=100),
        change_at=50,
        script="pick BlueBox; to (0, 0, 0.105) GreenBox; release",
        demonstrations=3,
        reached=2,
        use="genes",
        wanted=-65.0,
    ),
    Experiment(
        number=2,
        title="a pyramid whose top is not in the gene pool, demonstrated at generation 50",
        before="pyramid",
        task="pyramid",
        config=GPConfig(method="population", generations=100),
        change_at=50,
        script="pick GreenBox; to (-0.065, 0, 0.155) KittingBox; release",
        demonstrations=3,
        reached=2,
        use="genes",
        wanted=-55.0,
    ),
    Experiment(
        number=3,
        title="a stack in the wrong order; unstacking is demonstrated once, before evolution begins",
        task="restack",
        config=GPConfig(method="population", generations=200, population=32, p_add=0.1, p_delete=0.3, p_change=0.6),
        script="""pick GreenBox; to (-1.3, -1.3, 0.75) base_link; release
                  pick BlueBox; to (-0.3, -1.3, 0.75) base_link; release""",
        demonstrations=1,
        use="subgoal",
        wanted=-100.0,
        baseline_index=0,
    ),
)


@dataclasses.dataclass(frozen=True)
class VariantResult:
    """The results of R runs of one variant."""

    experiment: Experiment
    variant: Variant
    best: Float32[np.ndarray, "R G"]  # fitness of the best individual in each generation
    trees: list[Tree]
    episodes: list[int]
    solved_unseen: list[float]  # share of unseen layouts that the best tree of each run solves
    history: list[Generation]
    seconds: float
    compile_seconds: float  # of these
    lesson: Lesson | None


def perform(
    experiment: Experiment,
    variant: Variant,
    *,
    runs: int,
    seed: int = 0,
    test_layouts: int = 100,
    progress: Callable[[int], None] = lambda generation: None,
) -> VariantResult:
    """Run one variant of an experiment `runs` times; `progress` is told each generation."""
    began = time.monotonic()
    with CompileClock() as clock:
        settings = Settings(test_layouts=test_layouts)
        config = dataclasses.replace(experiment.config, runs=runs, seed=seed)
        if variant == "achievements":
            same = ("population", "generations", "runs", "seed", "max_nodes")
            config = GPConfig(**{name: getattr(config, name) for name in same})
        lesson = demonstrated(experiment, settings) if variant == "with_demonstration" else None
        states: list[State] = []
        history: list[Generation] = []

        def evolve(training: Training, state: State | None) -> None:
            for new in training.evolution.run(state):
                if new is not state:
                    states.append(new)
                    history.extend(training.evolution.describe(new))
                    progress(new.generation)

        carried = None
        if experiment.before is not None:
            first = Training(
                load_task(experiment.before), dataclasses.replace(config, generations=experiment.change_at), settings
            )
            evolve(first, None)
        training = _with_lesson(experiment, config, settings, lesson)
        if experiment.before is not None:
            carried = training.carried(states[-1], first.vocabulary.leaves)
        evolve(training, carried)
        trees = training.best_trees(states[-1])
        return VariantResult(
            experiment,
            variant,
            best=np.array([np.asarray(state.population.fitness).max(axis=1) for state in states]).T,
            trees=trees,
            episodes=states[-1].trees_measured,
            solved_unseen=[training.test(tree).success_rate for tree in trees],
            history=history,
            seconds=time.monotonic() - began,
            compile_seconds=clock.seconds,
            lesson=lesson,
        )


def demonstrated(experiment: Experiment, settings: Settings) -> Lesson:
    """Return what is learnt from the experiment's demonstrations, recorded in the simulator."""
    task = load_task(experiment.task)
    physics = make_level(task, settings)
    targets = task.targets[: experiment.reached]
    recorded = record(
        task,
        physics,
        parse_script(experiment.script),
        count=experiment.demonstrations,
        noise=NOISE,
        after=plan_task(dataclasses.replace(task, targets=targets)) if targets else None,
    )
    return learn(Demonstrations(Frames.of(task), tuple(recorded)), task)


def _with_lesson(experiment: Experiment, config: GPConfig, settings: Settings, lesson: Lesson | None) -> Training:
    task: Task = load_task(experiment.task)
    if lesson is None:
        return Training(task, config, settings)
    config = dataclasses.replace(config, baseline_index=experiment.baseline_index)
    if experiment.use == "genes":
        return Training(task, config, settings, baseline=lesson.tree, extra_leaves=lesson.genes)
    gene: Behavior = lesson.subtask_gene("demonstrated")
    return Training(task, config, settings, baseline=gene, extra_leaves=(gene,))
