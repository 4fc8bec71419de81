"""From demonstrations to a Behavior Tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, Tree, placing_gene
from bt_jax.encoding.walk import children, leaves
from bt_jax.lfd.choice import with_chosen, with_turns
from bt_jax.lfd.clustering import NEEDED
from bt_jax.lfd.constraints import Order, check_acyclic, meant, orders, preconditions
from bt_jax.lfd.demonstration import Demonstration, Demonstrations
from bt_jax.lfd.goals import Step, Subtask, sequences, subtasks
from bt_jax.lfd.inference import Inference, infer
from bt_jax.lfd.placements import target_of
from bt_jax.lfd.planner import plan
from bt_jax.lfd.subgoals import derive_subgoal
from bt_jax.tasks import Subgoal, Target, Task

__all__ = ["LearntSubtask", "Lesson", "learn"]


@dataclasses.dataclass(frozen=True)
class LearntSubtask:
    """What the demonstrations of one goal taught. `preconditions` are those of actions beyond the actions' own."""

    subtask: Subtask
    constraints: tuple[Order, ...]
    preconditions: Mapping[Behavior, tuple[Behavior, ...]]
    tree: Tree


@dataclasses.dataclass(frozen=True)
class Lesson:
    """Everything that a set of demonstrations taught, with what it was inferred from.

    `steps` are the demonstrations as sequences of indices into `inferences`.
    """

    task: Task
    demonstrations: Demonstrations
    inferences: tuple[Inference, ...]
    steps: tuple[tuple[Step, ...], ...]
    subtasks: tuple[LearntSubtask, ...]
    tree: Tree

    @property
    def missing(self) -> int:
        """How many more demonstrations are needed to infer the frames of the actions."""
        return max(0, NEEDED - len(self.demonstrations))

    @property
    def placements(self) -> tuple[Behavior, ...]:
        """The places `at(...)` in the goals, each once."""
        goals = (condition for one in self.subtasks for condition in one.subtask.goal)
        return tuple(dict.fromkeys(condition for condition in goals if condition.name == "at"))

    @property
    def genes(self) -> tuple[Behavior, ...]:
        """A `move` or `carry` gene for each demonstrated place, and whatever other leaves the tree has."""
        moves = [Behavior(placing_gene(self.task), place.args) for place in self.placements]
        return tuple(dict.fromkeys([*moves, *leaves(self.tree)]))

    @property
    def targets(self) -> tuple[Target, ...]:
        """The demonstrated places as targets. Raise UserError if the demonstrations have several goals."""
        if len(self.subtasks) > 1:
            raise UserError(
                f"the demonstrations end in {len(self.subtasks)} different ways, so they say no target; learn from those "
                "that agree"
            )
        objects = [place.object for place in self.placements]
        for name in objects:
            if objects.count(name) > len(self.task.instances.get(str(name), (name,))):
                raise UserError(
                    f"the demonstrations leave {name} at {objects.count(name)} different places, so it has no one target; "
                    "learn from those that agree"
                )
        slots = {Behavior("at", one.behavior.args): one.slot for one in self.inferences if one.slot}
        return tuple(dataclasses.replace(target_of(one), slot=slots.get(one, "")) for one in self.placements)

    def subgoal(self, name: str) -> Subgoal:
        """Return the configuration that the demonstrations reach: a subgoal of the task, or a new one of that name."""
        goal = [condition for one in self.subtasks for condition in one.subtask.goal]
        return derive_subgoal(name, self.demonstrations, goal, self.task)

    def subtask_gene(self, name: str) -> Behavior:
        """Return the whole tree as one gene of that name, done with for good once its subgoal has been reached."""
        reached = Behavior("reached", (self.subgoal(name).name,))
        return Behavior("subtask", (name, Control.fallback(reached, self.tree)))


def learn(demonstrations: Demonstrations, task: Task, *, frames: Mapping[int, str] | None = None) -> Lesson:
    """Learn a tree from demonstrations recorded in a task's scene.

    The corrections of the demonstrations count in place of what would be inferred. `frames` chooses the frame of inferences
    by hand besides, by their index in what is learnt without it.

    A demonstration that moves what the robot cannot is left out, with a sentence among the problems. Raise UserError if
    the frames or boxes are not those of the task, the demonstrations contradict each other in a circle, or no tree achieves
    what they do.
    """
    _check_scene(demonstrations, task)
    demonstrations = _usable(demonstrations, task)
    inferred = infer(demonstrations, task)
    inferences = with_chosen(inferred, demonstrations, demonstrations.corrections.frames, task)
    if frames:
        demonstrations = _with_frames(demonstrations, inferences, frames)
        inferences = with_chosen(inferred, demonstrations, demonstrations.corrections.frames, task)
    inferences = with_turns(inferences, demonstrations.corrections.turns)
    steps = sequences(demonstrations, inferences)
    things = [one.things(demonstrations.frames) for one in demonstrations]
    parts = [name for name in task.instances if name not in task.object_names]
    learnt = []
    for subtask in subtasks(inferences, steps, things):
        shown = [steps[d] for d in subtask.demonstrations]
        constraints = meant(orders(shown), steps, demonstrations.corrections.orders)
        check_acyclic(constraints, inferences)
        extra = preconditions(constraints, inferences, shown, [things[d] for d in subtask.demonstrations], parts=parts)
        tree = plan(subtask.goal, extra=extra, parts=parts, drives=task.robot.base is not None)
        learnt.append(LearntSubtask(subtask, constraints, extra, tree))
    trees = tuple(one.tree for one in learnt)
    tree = trees[0] if len(trees) == 1 else _either(trees)
    return Lesson(task, demonstrations, inferences, tuple(map(tuple, steps)), tuple(learnt), tree)


def _either(trees: Sequence[Tree]) -> Tree:
    """Return one of the trees: the first that can be carried out. A Fallback among them dissolves into it."""
    parts = [part for tree in trees for part in (children(tree) if _is_fallback(tree) else [tree])]
    return Control.fallback(*parts)


def _is_fallback(tree: Tree) -> bool:
    return isinstance(tree, Control) and tree.kind == Kind.FALLBACK


def _check_scene(demonstrations: Demonstrations, task: Task) -> None:
    frames = demonstrations.frames
    for name in frames.names:
        if name not in task.frames:
            known = ", ".join(task.frames)
            raise UserError(
                f"the demonstrations have a frame '{name}' that task {task.name} has not; use one of {known}"
            )
    for name in (task.robot_frame, *task.object_names):
        if name not in frames.names:
            raise UserError(f"the demonstrations lack the frame {name} of task {task.name}; record them in that task")
    if frames.robot != task.robot_frame:
        raise UserError(f"the robot's frame is {frames.robot} in the demonstrations and {task.robot_frame} in the task")
    if frames.recorded is not None and (difference := frames.recorded.difference(task)) is not None:
        raise UserError(
            f"the demonstrations do not fit: {difference}; choose task {frames.recorded.name}, or record them again"
        )


def _with_frames(
    demonstrations: Demonstrations, inferences: Sequence[Inference], frames: Mapping[int, str]
) -> Demonstrations:
    chosen = dict(demonstrations.corrections.frames)
    for index, frame in frames.items():
        if not 0 <= index < len(inferences):
            raise UserError(
                f"there is no action {index + 1} to choose a frame for; choose one from 1 to {len(inferences)}"
            )
        chosen |= dict.fromkeys(inferences[index].instances, frame)
    corrections = dataclasses.replace(demonstrations.corrections, frames=chosen)
    return dataclasses.replace(demonstrations, corrections=corrections)


def _usable(demonstrations: Demonstrations, task: Task) -> Demonstrations:
    """Return the demonstrations that move boxes only. Raise UserError if none does."""
    good: dict[int, Demonstration] = {}
    problems = list(demonstrations.problems)
    for d, one in enumerate(demonstrations):
        things = one.things(demonstrations.frames)
        wrong = next((name for name in things if name not in task.object_names), None)
        if wrong is None:
            good[d] = one
        else:
            problems.append(f"{one.name} is left out: it picks {wrong}, which the robot cannot move; record it again.")
    if not good:
        raise UserError(" ".join(problems) if problems else "there are no demonstrations; record some")
    corrections = demonstrations.corrections.renumbered({d: number for number, d in enumerate(good)})
    return Demonstrations(demonstrations.frames, tuple(good.values()), tuple(problems), corrections)
