"""How well frames, goals and orders are inferred: random sets of synthetic demonstrations with known answers.

Some frames cannot be distinguished in principle: if the kit stood on the same table in all demonstrations, a place in
the kit is also one in the robot's frame. So an inferred frame is judged strictly, as the true one, and leniently, as
one that would have moved together with it in all demonstrations of the set had there been no noise.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from bt_jax.behaviors import Behavior
from bt_jax.lfd.demonstration import Demonstrations, Frames, Instance
from bt_jax.lfd.evaluation.synthetic import demonstrate, random_situations, random_truth, reordered
from bt_jax.lfd.evaluation.synthetic_kits import demonstrate_kit
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson
from bt_jax.lfd.turns import REACH, apart
from bt_jax.tasks import Target, Task

__all__ = ["Assessment", "Example", "assess", "kit_example", "random_example", "situations_example", "tells_apart"]

TOGETHER = 1e-6  # metres; frames whose offset varies by less move together


@dataclasses.dataclass(frozen=True)
class Example:
    """Demonstrations with their ground truth: `shown` are the placements of each, `exact` the same without noise."""

    task: Task
    shown: tuple[tuple[Target, ...], ...]
    demonstrations: Demonstrations
    exact: Demonstrations

    def instances(self, placement: Target) -> list[Instance]:
        """Return the place actions that demonstrate a placement."""
        return [Instance(d, 2 * shown.index(placement) + 1) for d, shown in enumerate(self.shown) if placement in shown]

    @property
    def final(self) -> tuple[Target, ...]:
        """The placements of the first demonstration that hold in the end: the last of each object, all of a part."""
        shown = self.shown[0]
        last = {placement.object: i for i, placement in enumerate(shown)}
        return tuple(one for i, one in enumerate(shown)
                     if last[one.object] == i or one.object not in self.task.object_names)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Assessment:
    """Of `placements` observed place actions, how many were recognized in the true frame (`strict`) or in one that
    moved with it (`lenient`), with the right turn, or rightly free (`turns`), and in the right slot, or rightly in none
    (`slots`); whether the goal and all orders are right."""

    placements: int
    strict: int
    lenient: int
    goal: bool
    order: bool
    turns: int = 0
    slots: int = 0


def random_example(task: Task, *, seed: Sequence[int], count: int, noise: float, reorder: bool = False) -> Example:
    """`count` demonstrations of random placements; with `reorder` each in a random order, as far as they do not depend on
    each other. The same for the same seed."""
    rng = np.random.default_rng([*seed, count])
    truth = random_truth(task, rng=rng)
    shown = tuple(reordered(truth, rng=rng) if reorder else truth for _ in range(count))
    return _recorded(task, shown, seed=seed, count=count, noise=noise)


def situations_example(task: Task, *, seed: Sequence[int], count: int, noise: float) -> Example:
    """`count` demonstrations of each of two random situations, which place one object in different frames, all in a random
    order. The same for the same seed."""
    rng = np.random.default_rng([*seed, count])
    situations = random_situations(task, rng=rng) * count
    shown = tuple(reordered(situations[i], rng=rng) for i in rng.permutation(2 * count))
    return _recorded(task, shown, seed=seed, count=count, noise=noise)


def _recorded(
    task: Task, shown: tuple[tuple[Target, ...], ...], *, seed: Sequence[int], count: int, noise: float
) -> Example:
    def recorded(noise: float) -> Demonstrations:
        made = [
            demonstrate(task, one, rng=np.random.default_rng([*seed, count, d]), noise=noise, name=f"demo{d + 1}")
            for d, one in enumerate(shown)
        ]
        return Demonstrations(Frames.of(task), tuple(made))

    return Example(task, shown, recorded(noise), recorded(0.0))


def kit_example(
    task: Task, *, seed: Sequence[int], count: int, noise: float, turn_noise: float, reorder: bool
) -> Example:
    """`count` demonstrations of the targets of a kit; with `reorder` each in a random order, as far as they do not depend on
    each other. The same for the same seed."""
    rng = np.random.default_rng([*seed, count])
    shown = tuple(reordered(task.targets, rng=rng) if reorder else task.targets for _ in range(count))

    def recorded(scale: float) -> Demonstrations:
        made = [
            demonstrate_kit(
                task,
                one,
                rng=np.random.default_rng([*seed, count, d]),
                noise=scale * noise,
                turn_noise=scale * turn_noise,
                name=f"demo{d + 1}",
            )
            for d, one in enumerate(shown)
        ]
        return Demonstrations(Frames.of(task), tuple(made))

    return Example(task, shown, recorded(1.0), recorded(0.0))


def tells_apart(lesson: Lesson, example: Example) -> bool:
    """Return whether each placement of an example is one inference, of all that demonstrate it and no others, in a frame
    that moved with the true one."""
    found = {frozenset(one.instances): one for one in lesson.inferences}
    placements = dict.fromkeys(placement for shown in example.shown for placement in shown)
    inferences = {placement: found.get(frozenset(example.instances(placement))) for placement in placements}
    return all(one is not None and _is_right(one, placement, example) for placement, one in inferences.items())


def assess(lesson: Lesson, example: Example) -> Assessment:
    """Compare what was learnt from the demonstrations of an example with its ground truth."""
    step_at = {instance: step for step, one in enumerate(lesson.inferences) for instance in one.instances}
    truth = example.shown[0]
    strict = lenient = turns = slots = 0
    for placement in truth:
        for instance in example.instances(placement):
            inference = lesson.inferences[step_at[instance]]
            strict += inference.frame == placement.frame
            lenient += _is_right(inference, placement, example)
            turns += _is_turned(inference, placement, example)
            slots += inference.slot == placement.slot
    meanings = {step_at[instance]: placement for placement in truth for instance in example.instances(placement)}
    return Assessment(
        placements=len(truth) * len(example.shown),
        strict=strict,
        lenient=lenient,
        goal=_goal_is_right(lesson, example, step_at),
        order=_orders(lesson, meanings) == _constant_orders(example.shown),
        turns=turns,
        slots=slots,
    )


def _is_right(inference: Inference, placement: Target, example: Example) -> bool:
    """Return whether the inferred frame moved with the true one."""
    instances = example.instances(placement)
    actions = [example.exact.demonstrations[instance.demonstration].actions[instance.index] for instance in instances]
    offsets = np.array([one.handled(inference.frame) - one.handled(placement.frame) for one in actions])
    return inference.object == placement.object and float(np.ptp(offsets, axis=0).max()) < TOGETHER


def _is_turned(inference: Inference, placement: Target, example: Example) -> bool:
    """Return whether a turn is asked for exactly where one was meant, and that one."""
    if inference.turn is None or placement.turn is None:
        return inference.turn == placement.turn
    symmetry = example.task.thing(placement.object).symmetry
    return bool(apart(np.array([inference.turn]), placement.turn, symmetry)[0] <= REACH)


def _goal_is_right(lesson: Lesson, example: Example, step_at: dict[Instance, int]) -> bool:
    """Return whether there is one subtask, whose goal is what holds in the end and no more, to the tolerance of the task."""
    if len(lesson.subtasks) != 1 or len(lesson.placements) != len(example.final):
        return False
    for placement in example.final:
        instances = example.instances(placement)
        steps = {step_at[instance] for instance in instances}
        inference = lesson.inferences[steps.pop()]
        exact = [
            example.exact.demonstrations[m.demonstration].actions[m.index].handled(inference.frame) for m in instances
        ]
        error = np.linalg.norm(np.mean(exact, axis=0) - inference.position)
        known = Behavior("at", inference.behavior.args) in lesson.placements
        if steps or not known or not _is_right(inference, placement, example) or error > example.task.episode.tolerance:
            return False
    return True


def _orders(lesson: Lesson, meanings: dict[int, Target]) -> set[tuple[Target, Target]]:
    """Return the inferred orders of placements."""
    pairs = [(order.before, order.after) for one in lesson.subtasks for order in one.constraints]
    return {(meanings[before], meanings[after]) for before, after in pairs if before in meanings and after in meanings}


def _constant_orders(shown: Sequence[Sequence[Target]]) -> set[tuple[Target, Target]]:
    return {
        (before, after)
        for before in shown[0]
        for after in shown[0]
        if all(one.index(before) < one.index(after) for one in shown)
    }
