"""Runs that go on, and what demonstrations change in them: more genes, a tree to start from, other targets, a subgoal with
its reward."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree
from bt_jax.encoding.walk import leaves as tree_leaves
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Corrections, DemonstrationFolder, Lesson, learn, plan_task
from bt_jax.tasks import Task, with_goal_of, with_subgoal, with_targets
from bt_jax.training.run_config import RunConfig, package_version
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

__all__ = ["KEPT", "Changes", "choose_frames", "lesson_from", "resumed", "subgoal_name"]

KEPT = (
    "a run that goes on keeps its settings; give only --generations, --patience, --target-fitness or --time-limit, or a "
    "new --task, --baseline, --plan, --add-target-from or --add-subgoal-from"
)


NO_BASELINE = (
    "there is no new baseline to insert; leave out --baseline-index, or give --baseline, --plan or demonstrations"
)


@dataclasses.dataclass(frozen=True)
class Changes:
    """What is new in a training, or in the next phase of one. `plan`: a planner's tree for the targets is the baseline;
    `task`: the targets and starts are those of this task."""

    baseline: Tree | None = None
    plan: bool = False
    target_from: Path | None = None
    subgoal_from: Path | None = None
    baseline_index: int | None = None
    task: Task | None = None

    @property
    def begin_phase(self) -> bool:
        """Whether these begin another phase of a run."""
        return dataclasses.replace(self, baseline_index=None) != Changes()

    def applied(self, config: RunConfig) -> RunConfig:
        """Return the configuration with these changes.

        Demonstrations of targets add their places to the targets and to the gene pool, and their tree is the baseline if no
        other is given. Demonstrations of a subgoal become one gene, guarded by `reached(subgoal)`; the task rewards reaching
        it (one of its own, if they reach that), and the gene is the baseline if there is no other.
        """
        task = config.task if self.task is None else with_goal_of(config.task, self.task)
        leaves, baseline = list(config.extra_leaves), self.baseline
        if config.baseline is not None:
            leaves += [leaf for leaf in tree_leaves(config.baseline) if leaf not in leaves]
        if self.target_from is not None:
            lesson = lesson_from(self.target_from, task)
            try:
                targets = lesson.targets
            except UserError as error:
                raise UserError(f"{self.target_from}: {error}") from None
            task = with_targets(task, targets, source=str(self.target_from))
            leaves += lesson.genes
            baseline = baseline or lesson.tree
        if self.subgoal_from is not None:
            lesson, name = lesson_from(self.subgoal_from, task), subgoal_name(self.subgoal_from)
            task = with_subgoal(task, lesson.subgoal(name), source=str(self.subgoal_from))
            gene = lesson.subtask_gene(name)
            leaves.append(gene)
            baseline = baseline or gene
        if self.plan:
            if baseline is not None:
                raise UserError("two baselines are given; leave out --plan, or --baseline and the demonstrations")
            baseline = plan_task(task)
        gp = dataclasses.replace(config.gp, baseline_index=self.baseline_index)
        if baseline is None and self.baseline_index is not None:
            raise UserError(NO_BASELINE, code="new baseline")
        return dataclasses.replace(
            config, task=task, baseline=baseline, extra_leaves=tuple(dict.fromkeys(leaves)), gp=gp
        )


def resumed(folder: RunFolder, gp: GPConfig, settings: Settings, changes: Changes) -> RunConfig:
    """Return the configuration with which a run goes on: for as long as `gp` says, in a new phase if there are
    changes. Where a baseline enters is for the changes to say; without a new one, the run keeps its own.

    Raise UserError if anything else differs from the run's own settings, if the run has reached other generations than it is
    given, or if its version was another.
    """
    config = folder.config()
    if config.version != package_version():
        raise UserError(
            f"{folder.path} was begun with version {config.version} and this is {package_version()}; go on "
            "with that version, or train again"
        )
    if config.x64:
        raise UserError(f"{folder.path} was evolved with 64-bit numbers, and this command has 32-bit ones; train again")
    gp = dataclasses.replace(gp, baseline_index=config.gp.baseline_index)
    fixed = dataclasses.replace(gp, generations=config.gp.generations, patience=config.gp.patience)
    if fixed != config.gp or settings != config.settings:
        raise UserError(KEPT)
    phase = changes.begin_phase
    if not phase and changes.baseline_index is not None:
        raise UserError(NO_BASELINE, code="new baseline")
    try:
        config.gp.check()
        config.settings.check()
    except UserError as error:
        raise UserError(f"{folder.path / 'config.json'}: {error}") from error
    gp.check()
    saved, generations = folder.load_checkpoint(), gp.num_generations
    now = 0 if saved is None else saved.state.generation
    if generations <= now and generations != config.gp.num_generations:
        raise UserError(
            f"the run is at generation {now} and {generations} are asked for; give --generations more than {now}",
            code="generations reached",
            now=now,
        )
    if not phase:
        return dataclasses.replace(config, gp=gp)
    if saved is None:
        raise UserError(f"{folder.path} has no generation yet to go on from; train again with these options")
    if generations <= now:
        gp = dataclasses.replace(gp, generations=now + max(1, now - config.since), patience=gp.num_patience)
    return changes.applied(dataclasses.replace(config, gp=gp, phase=config.phase + 1, since=now))


def lesson_from(folder: Path, task: Task) -> Lesson:
    """Learn from a folder of demonstrations. Raise UserError, naming it, if that fails."""
    demonstrations = DemonstrationFolder(folder).read()
    try:
        return learn(demonstrations, task)
    except UserError as error:
        raise UserError(f"{folder}: {error}") from None


def choose_frames(folder: Path, lesson: Lesson, frames: Mapping[int, str | None]) -> Lesson:
    """Return what is learnt from a folder with frames chosen by a person, by the index of an inference in what was
    learnt so far; None leaves it to the demonstrations again. The choices are kept with the demonstrations.

    Raise UserError, and keep nothing, if one is not possible.
    """
    count = len(lesson.inferences)
    if wrong := [index + 1 for index in frames if not 0 <= index < count]:
        raise UserError(f"there is no action {wrong[0]} to choose a frame for; choose one from 1 to {count}")
    learn(lesson.demonstrations, lesson.task, frames={i: frame for i, frame in frames.items() if frame is not None})
    for index, frame in frames.items():
        said = Corrections(frames=dict.fromkeys(lesson.inferences[index].instances, frame or ""))
        keep = DemonstrationFolder(folder).take_back if frame is None else DemonstrationFolder(folder).correct
        keep(lesson.demonstrations, said)
    return lesson_from(folder, lesson.task)


def subgoal_name(folder: Path) -> str:
    """Return a name for the subgoal that the demonstrations in a folder reach: that of the folder."""
    name = "".join(letter if letter.isalnum() else "_" for letter in folder.resolve().name)
    return name if name.isidentifier() else f"subgoal_{name}"
