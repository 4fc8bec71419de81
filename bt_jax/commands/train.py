"""What `python -m bt_jax.train` does: evolve a Behavior Tree for a task."""

from __future__ import annotations

import dataclasses
import itertools
import shlex
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.files import unused
from bt_jax._util.startup import configure_jax
from bt_jax._util.words import listed
from bt_jax.behaviors import Behavior, subgoal_conditions
from bt_jax.commands.arguments import TrainArguments
from bt_jax.encoding.formats.files import check_tree, read_tree
from bt_jax.tasks import Task, load_faults, load_task, with_faults
from bt_jax.tasks.changes import not_taken_over
from bt_jax.training.console import TrainingDisplay
from bt_jax.training.phases import KEPT, Changes, resumed
from bt_jax.training.progress import Reporter
from bt_jax.training.run import TrainingRun
from bt_jax.training.run_config import RunConfig, parse_leaf
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.training import Training

__all__ = ["run", "warm"]


def run(arguments: TrainArguments) -> None:
    """Train as the arguments say, and write the run folder."""
    configure_jax(arguments.device)
    config, folder = _configuration(arguments)
    left = _not_taken_over(arguments)
    if arguments.resume is None and not folder.is_free:
        if not folder.path.is_dir():
            raise UserError(f"{folder.path} is a file; choose another --out")
        remedy = "choose another --out"
        if (folder.path / "config.json").is_file():
            remedy += f", or continue it with --resume {shlex.quote(str(folder.path))}"
        raise UserError(f"{folder.path} is not empty; {remedy}")
    run = TrainingRun(folder, config, resumed=arguments.resume is not None)
    display = TrainingDisplay(run.training, folder.path)
    reporters = [Reporter(folder.path, config.gp.num_generations)] if arguments.progress else []
    with run.opened(*reporters, display):
        if left:
            display.warn(
                f"of {arguments.task}, only the targets and the layout count; the run keeps its {listed(left)}"
            )
        result, session = run.evolve(target=arguments.target_fitness, time_limit=arguments.time_limit)
        try:
            display.finish(result, session)
        finally:  # nobody waits for pictures, and nobody loses them, whatever happens to the console
            problem = run.draw(result)
        if problem:
            display.warn(problem)
        if run.unwritten:
            raise UserError(f"the results, shown above, are not all in {folder.path}: {run.unwritten}")


def warm(arguments: TrainArguments, *, until: Callable[[], bool]) -> None:
    """Compile what `run` would need, by evolving two generations that are not kept; less if `until` says so."""
    training = Training.of(_configuration(arguments)[0])
    for state in itertools.islice(training.evolution.run(), 2):
        training.evolution.describe(state)
        training.best_tree(state)
        if until():
            break


def _configuration(arguments: TrainArguments) -> tuple[RunConfig, RunFolder]:
    """Return what to evolve, and the run folder for it; that of a resumed run comes from its folder."""
    arguments.check()
    changes = Changes(
        baseline=None if arguments.baseline is None else read_tree(arguments.baseline),
        plan=arguments.plan,
        target_from=arguments.add_target_from,
        subgoal_from=arguments.add_subgoal_from,
        baseline_index=arguments.gp.baseline_index,
    )
    if arguments.resume is not None:
        if arguments.name:
            raise UserError(KEPT)
        if arguments.task is not None:
            changes = dataclasses.replace(changes, task=_task(arguments.task))
        folder = RunFolder(arguments.resume)
        config = resumed(folder, arguments.gp, arguments.settings, changes)
    else:
        arguments.gp.check()
        arguments.settings.check()
        task = _task(arguments.task or arguments.name or "stack")
        if arguments.faults is not None:
            task = with_faults(task, load_faults(arguments.faults), source=f"--faults {arguments.faults}")
        folder = RunFolder(arguments.out or unused(Path("runs") / f"{task.name}-{datetime.now():%Y%m%d-%H%M%S}"))
        without = tuple(map(_leaf, arguments.without))
        config = changes.applied(RunConfig(task, arguments.gp, arguments.settings, without=without))
    if arguments.baseline is not None and changes.baseline is not None:
        check_tree(changes.baseline, config.task, arguments.baseline)
    return config, folder


def _not_taken_over(arguments: TrainArguments) -> list[str]:
    """Return what else differs between the task of a run that goes on and the one whose targets it gets."""
    if arguments.resume is None or arguments.task is None:
        return []
    return not_taken_over(RunFolder(arguments.resume).config().task, _task(arguments.task))


def _leaf(text: str) -> Behavior:
    """Return a leaf that evolution does without. Raise UserError if the text is not one."""
    try:
        return parse_leaf(text)
    except UserError as error:
        raise UserError(f"--without: {error}") from None


def _task(name_or_path: str | Path) -> Task:
    """Return a task. Raise UserError, naming file and key, if it is invalid, its subgoals included."""
    task = load_task(name_or_path)
    subgoal_conditions(task, source=str(name_or_path))
    return task
