"""Does one proposed demonstration settle what three leave open?

Random sets of three synthetic demonstrations that tie: it is open what some place is relative to. The same demonstrator
shows a fourth one from the start that `lfd.propose` arranges, or else from one more random start. A set is settled if
nothing is asked any more, and its tree works if it puts everything where it was meant in layouts that nothing has seen.

Two kinds of sets: `whole`, as in `benchmarks.demonstrations`; and `last step`, whose demonstrations show only the last
placement, beginning where the others have been made."""

from __future__ import annotations

import contextlib
import dataclasses
import itertools
import multiprocessing
import signal
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from rich.progress import Progress

from benchmarks._report import report
from bt_jax._util.errors import UserError
from bt_jax.lfd import Lesson, learn
from bt_jax.lfd.demonstration import Demonstration
from bt_jax.lfd.evaluation.assessment import random_example
from bt_jax.lfd.evaluation.synthetic import demonstrate, with_boxes
from bt_jax.lfd.proposing import propose
from bt_jax.lfd.questions import Question, open_questions
from bt_jax.lfd.rehearsal import rehearse
from bt_jax.mjx_env.episodes.fitness import target_misses
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Target, Task, load_task

COUNT = 3  # demonstrations that tie
BLOCK = 32  # sets that are handed out at a time
UNSEEN = 1 << 25  # seeds of layouts in which trees are tried; nothing else uses them


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Shares of tied sets that one more demonstration settles. Ctrl-C ends it with what was measured so far."""

    sets: int = 300
    """tied sets of each kind"""
    kinds: tuple[str, ...] = ("whole", "last step")
    """kinds of sets"""
    layouts: int = 10
    """unseen layouts for each tree"""
    seed: int = 0
    """of the random sets"""
    processes: int = 2
    """that look at sets at a time"""
    out: Path | None = None
    """where to write the JSON file"""


@dataclasses.dataclass(frozen=True)
class TiedSet:
    """What a demonstrator shows, the demonstrations so far, and what is known from them."""

    task: Task
    shown: tuple[Target, ...]
    meant: tuple[Target, ...]
    noise: float
    seed: tuple[int, ...]
    lesson: Lesson
    questions: tuple[Question, ...]

    def once_more(self, start: World | None) -> Demonstration:
        """One more demonstration from a state, or a random layout."""
        rng = np.random.default_rng([*self.seed, COUNT, COUNT])
        return demonstrate(self.task, self.shown, rng=rng, noise=self.noise, name=f"demo{COUNT + 1}", start=start)


def main(arguments: Arguments) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # also where a shell has started it in the background
    tallies = {kind: Tally() for kind in arguments.kinds}
    with multiprocessing.get_context("spawn").Pool(arguments.processes, _leave_ctrl_c) as pool, Progress() as progress:
        jobs = {kind: progress.add_task(kind, total=arguments.sets) for kind in tallies}
        with contextlib.suppress(KeyboardInterrupt):
            for block in itertools.count():
                left = [kind for kind, tally in tallies.items() if tally.counts["tied"] < arguments.sets]
                if not left:
                    break
                drawn = [(kind, block * BLOCK + i, arguments) for i in range(BLOCK) for kind in left]
                for (kind, _, _), found in zip(drawn, pool.imap(measured, drawn), strict=True):
                    tallies[kind].add(found, arguments.sets)
                    progress.update(jobs[kind], completed=tallies[kind].counts["tied"])
    rows = [tally.row(kind) for kind, tally in tallies.items()]
    failures = {kind: tally.failures for kind, tally in tallies.items()}
    report("proposing", "Settled by one more demonstration (%)", rows, out=arguments.out, failures=failures)


def _leave_ctrl_c() -> None:
    """Leave it to the first process to end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@dataclasses.dataclass
class Tally:
    """What was counted in the sets of a kind so far, of which `drawn` were looked at, in the order of their numbers."""

    drawn: int = 0
    counts: Counter[str] = dataclasses.field(default_factory=Counter)
    failures: list[str] = dataclasses.field(default_factory=list)

    def add(self, found: tuple[Counter[str], list[str]] | None, most: int) -> None:
        """Count a set, None if nothing is tied in it; with so many there are enough."""
        if self.counts["tied"] < most:
            self.drawn += 1
            if found is not None:
                self.counts.update(found[0])
                self.failures += found[1]

    def row(self, kind: str) -> dict[str, Any]:
        counts, tied = self.counts, max(self.counts["tied"], 1)
        share = {
            key: 100 * counts[key] / tied
            for key in ("works before", "proposed settles", "proposed works", "random settles", "random works")
        }
        return {"sets": kind, "drawn": self.drawn, "tied": counts["tied"], "questions": counts["questions"], **share}


def measured(drawn: tuple[str, int, Arguments]) -> tuple[Counter[str], list[str]] | None:
    """What one more demonstration does in the set of a number, None if nothing is tied in it."""
    kind, number, arguments = drawn
    one = tied_set(kind, (arguments.seed, number))
    if one is None:
        return None
    found = Counter({"tied": 1, "questions": len(one.questions), "works before": works(one.lesson, one, arguments)})
    failures = []
    proposal = propose(one.lesson, one.questions, seed=number)
    for name, start in (("proposed", proposal.start), ("random", None)):
        lesson, left = after(one, start)
        found[f"{name} settles"] = lesson is not None and not left
        found[f"{name} works"] = lesson is not None and works(lesson, one, arguments)
        if name == "proposed" and not found["proposed settles"]:
            failures.append(f"set {number}: {', '.join(question.kind for question in left) or 'not learnt'}")
    return found, failures


def tied_set(kind: str, seed: tuple[int, ...]) -> TiedSet | None:
    """The set of a seed, None if nothing is tied in it."""
    rng = np.random.default_rng(seed)
    noise = float(rng.uniform(0.005, 0.01))
    task = with_boxes(load_task("stack"), int(rng.integers(2, 7)))
    example = random_example(task, seed=seed, count=COUNT, noise=noise, reorder=kind == "whole" and bool(seed[-1] % 2))
    shown, meant, demonstrations = example.shown[0], example.final, example.demonstrations
    if kind == "last step":
        shown = meant = shown[-1:]
        last = [dataclasses.replace(one, actions=one.actions[-2:]) for one in demonstrations]
        demonstrations = dataclasses.replace(demonstrations, demonstrations=tuple(last))
    try:
        lesson = learn(demonstrations, task)
    except UserError:
        return None
    if not open_questions(lesson, kinds=("frame",)):
        return None
    return TiedSet(task, shown, meant, noise, seed, lesson, open_questions(lesson))


def after(one: TiedSet, start: World | None) -> tuple[Lesson | None, tuple[Question, ...]]:
    """What is learnt with one more demonstration, None if nothing can be, and what is still asked."""
    known = one.lesson.demonstrations
    more = dataclasses.replace(known, demonstrations=(*known.demonstrations, one.once_more(start)))
    try:
        lesson = learn(more, one.task)
    except UserError:
        return None, ()
    return lesson, open_questions(lesson)


def works(lesson: Lesson, one: TiedSet, arguments: Arguments) -> bool:
    """Whether the tree brings everything to where it was meant in layouts that nothing has seen."""
    task = dataclasses.replace(one.task, targets=one.meant)
    layouts = sample_layouts(task, [UNSEEN, *one.seed], arguments.layouts)
    done = rehearse(lesson.tree, task, layouts)
    return all(bool(target_misses(task, each.final).met.all()) for each in done)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
