"""What `python -m bt_jax.train` does: evolve a Behavior Tree for a task."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import signal
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.files import unused
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.commands.arguments import TrainArguments
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.evolution import Generation, State, best_of
from bt_jax.tasks import load_task
from bt_jax.training.console import Session, TrainingDisplay
from bt_jax.training.phases import Changes, baseline_from
from bt_jax.training.plots import learning_curve
from bt_jax.training.progress import Reporter, locked
from bt_jax.training.run_folder import Checkpoint, RunConfig, RunFolder, package_version
from bt_jax.training.training import Training

__all__ = ["run", "warm"]

CHECKPOINT_SECONDS = 2.0
CHECKPOINT_SHARE = 20  # of the time goes into checkpoints: at most one part in so many


def run(arguments: TrainArguments) -> None:
    """Trains as the arguments say, and writes the run folder."""
    configure_jax(arguments.device)
    config, folder = _configuration(arguments)
    training = _training(config)
    config, resume = _pinned(config, training), arguments.resume is not None
    with contextlib.ExitStack() as stack:
        if not resume:
            folder.start(config)
        stack.enter_context(locked(folder.path))
        reporter = stack.enter_context(Reporter(folder.path if arguments.progress else None, config.gp.generations))
        if resume:
            _begin_again(folder, config)
        _train(training, folder, config, arguments, reporter)


def warm(arguments: TrainArguments, *, until: Callable[[], bool]) -> None:
    """Compiles what `run` would need, by evolving two generations that are not kept; or less, where `until` says so."""
    training = _training(_configuration(arguments)[0])
    for state in itertools.islice(training.evolution.run(), 2):
        training.evolution.describe(state)
        training.best_tree(state)
        if until():
            break


def _train(
    training: Training, folder: RunFolder, config: RunConfig, arguments: TrainArguments, reporter: Reporter
) -> None:
    """Evolves until it is done or stopped, and writes the results."""
    display = TrainingDisplay(training, folder.path)
    state, history = _restored(training, folder.load_checkpoint(), config)
    clock, began, stopped = CompileClock(), time.monotonic(), False
    interruption = _Interruption()
    signal.signal(signal.SIGTERM, interruption)
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, interruption)
    try:
        with display:
            state, history = _evolve(
                training, folder, display, reporter, state, history, arguments, config, interruption
            )
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # until what was learnt is saved
        stopped = True
        state, history = display.last
        if state is None:
            raise UserError("stopped before the first generation was measured; nothing was learnt") from None
    session = Session(time.monotonic() - began, clock.seconds, training.num_broken, stopped)
    reporter.update(history, lambda: one_line(training.best_tree(state)), now=True)
    reporter.stage("testing")
    _save(folder, config, Checkpoint(state, training.vocabulary.leaves, config.phase, history))
    folder.save_tree(training.best_tree(state), title=config.task.name)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if stopped:
        # The interruption may have come in the middle of an entry into the table: the test starts from a new one.
        training = _training(config)
    _finish(training, folder, display, state, history, session)
    reporter.stage("stopped" if stopped else "finished")


class _Interruption:
    """Handles a signal that ends an evolution: at once, or after this generation where Python was in a place, such as a
    destructor, that swallows exceptions."""

    def __init__(self) -> None:
        self._asked = False

    def __call__(self, *_: object) -> None:
        self._asked = True
        raise KeyboardInterrupt

    def check(self) -> None:
        """Raises KeyboardInterrupt where there was a signal."""
        if self._asked:
            raise KeyboardInterrupt


def _training(config: RunConfig) -> Training:
    return Training(config.task, config.gp, config.settings, baseline=config.baseline, extra_leaves=config.extra_leaves)


def _begin_again(folder: RunFolder, config: RunConfig) -> None:
    """Writes the configuration of a run that goes on, or of its next phase."""
    if folder.config().phase < config.phase:
        folder.begin_phase(config)
    else:
        folder.start(config, resume=True)


def _restored(training: Training, saved: Checkpoint | None, config: RunConfig) -> tuple[State | None, list[Generation]]:
    """Where to go on: at the checkpoint, measured anew where it is from the phase before; a new run where there is none."""
    if saved is None:
        return None, []
    if saved.phase == config.phase:
        return saved.state, saved.history
    return training.carried(saved.state, saved.leaves), saved.history


def _pinned(config: RunConfig, training: Training) -> RunConfig:
    """With the backend that `auto` stands for here, so that a resumed run takes the same everywhere."""
    if config.settings.level != "physics":
        return config
    return dataclasses.replace(config, settings=dataclasses.replace(config.settings, backend=training.level.name))


def _configuration(arguments: TrainArguments) -> tuple[RunConfig, RunFolder]:
    """What to evolve, and the run folder for it; that of a resumed run comes from its folder."""
    if arguments.resume is not None:
        if arguments.out is not None:
            raise UserError("--resume goes on in its own folder; leave out --out")
        folder = RunFolder(arguments.resume)
        return _resumed(arguments, folder), folder
    if arguments.name is not None and arguments.task is not None:
        raise UserError("two tasks are given; name one, or give one file with --task")
    arguments.gp.check()
    arguments.settings.check()
    task = load_task(arguments.task or arguments.name or "stack")
    out = arguments.out or unused(Path("runs") / f"{task.name}-{datetime.now():%Y%m%d-%H%M%S}")
    return _changes(arguments).applied(RunConfig(task, arguments.gp, arguments.settings)), RunFolder(out)


def _changes(arguments: TrainArguments) -> Changes:
    return Changes(
        baseline=None if arguments.baseline is None else baseline_from(arguments.baseline),
        plan=arguments.plan,
        target_from=arguments.add_target_from,
        subgoal_from=arguments.add_subgoal_from,
        baseline_index=arguments.gp.baseline_index,
    )


def _resumed(arguments: TrainArguments, folder: RunFolder) -> RunConfig:
    """The saved configuration, with as many generations as are asked for now, or that of the next phase."""
    config = folder.config()
    if config.version != package_version():
        raise UserError(
            f"{folder.path} was begun with version {config.version} and this is {package_version()}; go on "
            "with that version, or train again"
        )
    changes = _changes(arguments)
    changed = dataclasses.replace(changes, baseline_index=None) != Changes()
    free = {"generations": config.gp.generations, "baseline_index": config.gp.baseline_index if changed else None}
    same = dataclasses.replace(arguments.gp, **free) == dataclasses.replace(config.gp, **free)
    if not same or arguments.settings != config.settings or arguments.name or arguments.task:
        raise UserError(
            "--resume keeps task and settings; give only --generations, --target-fitness or --time-limit, or a new "
            "--baseline, --add-target-from or --add-subgoal-from"
        )
    arguments.gp.check()
    if not changed:
        return dataclasses.replace(config, gp=dataclasses.replace(config.gp, generations=arguments.gp.generations))
    saved = folder.load_checkpoint()
    if saved is None:
        raise UserError(f"{folder.path} has no generation yet to go on from; train again with these options")
    now, generations = saved.state.generation, arguments.gp.generations
    if generations <= now and generations != config.gp.generations:
        raise UserError(f"the run is at generation {now} and --generations is {generations}; give more than {now}")
    if generations <= now:
        generations = now + max(1, now - config.since)
    gp = dataclasses.replace(arguments.gp, generations=generations)
    return changes.applied(dataclasses.replace(config, gp=gp, phase=config.phase + 1, since=now))


def _evolve(
    training: Training,
    folder: RunFolder,
    display: TrainingDisplay,
    reporter: Reporter,
    state: State | None,
    history: list[Generation],
    arguments: TrainArguments,
    config: RunConfig,
    interruption: _Interruption,
) -> tuple[State, list[Generation]]:
    known = {row.generation for row in history}
    saved, wait = time.monotonic(), CHECKPOINT_SECONDS
    generations = training.evolution.run(state, target=arguments.target_fitness, time_limit=arguments.time_limit)
    for state in generations:
        if state.generation not in known:
            history = [*history, *training.evolution.describe(state)]
        display.update(state, history)
        reporter.update(history, lambda state=state: one_line(training.best_tree(state)))
        if time.monotonic() - saved >= wait:
            began = time.monotonic()
            _save(folder, config, Checkpoint(state, training.vocabulary.leaves, config.phase, history))
            saved = time.monotonic()
            wait = max(CHECKPOINT_SECONDS, CHECKPOINT_SHARE * (saved - began))
        interruption.check()
    return state, history


def _save(folder: RunFolder, config: RunConfig, checkpoint: Checkpoint) -> None:
    """Replaces the checkpoint; where somebody has removed the folder meanwhile, it is made anew."""
    if not (folder.path / "config.json").is_file():
        folder.start(config, resume=True)
    folder.save_checkpoint(checkpoint)


def _finish(
    training: Training,
    folder: RunFolder,
    display: TrainingDisplay,
    state: State,
    history: list[Generation],
    session: Session,
) -> None:
    """Tests the learnt tree, writes everything that people look at, and says so."""
    result = training.result(state, history)
    title = f"{training.task.name}: fitness {result.fitness:.1f}"
    folder.save_tree(result.tree, title=title)
    folder.save_history(history)
    folder.save_result(
        {
            "fitness": result.fitness,
            "success_rate": result.test.success_rate,
            "test_layouts": len(result.test.solved),
            "test_fitness_mean": float(result.test.fitness.mean()),
            "test_fitness_std": float(result.test.fitness.std()),
            "generations": state.generation,
            "episodes": state.trees_measured,
            "last_session": dataclasses.asdict(session),
            "runs": [{"fitness": float(f), "tree": t} for f, t in zip(best_of(state)[1], result.lines, strict=True)],
        }
    )
    folder.save_picture("learning_curve.png", learning_curve(history, title=training.task.name, phases=folder.phases()))
    if (picture := training.picture(result.tree)) is not None:
        folder.save_picture("solved.png", picture)
    display.finish(result, state, session)
