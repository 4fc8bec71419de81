"""What a training shows in the terminal while it runs, and at its end."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import jax
from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.text import Text

from bt_jax._util.words import counted
from bt_jax.behaviors import Tree
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.walk import prefix
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import Generation
from bt_jax.gp.search import AchievementSearch
from bt_jax.mjx_env.episodes.adaptive import AdaptiveEvaluator
from bt_jax.training.bar import GenerationBar
from bt_jax.training.progress import Stage
from bt_jax.training.result import EXPLAINED, Failures, Result, Session, Test
from bt_jax.training.training import Training

__all__ = ["TrainingDisplay", "failures_met", "faults_met", "where_tested"]

PLURALS: Mapping[str, str] = MappingProxyType(
    {  # fault, a key of `tasks.faults.FAULTS` -> what a count of episodes with it is called
        "slip": "slips",
        "drop": "drops",
        "jam": "jams",
        "misplace": "misplaced",
        "hide": "out of sight",
        "move": "moved by a person",
        "take": "taken away",
        "heavy": "heavy",
    }
)
COMMONEST = 3  # ways of failing
LISTED = 8  # numbers of layouts that fail for one reason
MORE = 50  # generations that are suggested for a run that has ended


class TrainingDisplay:
    """Shows a run on the console, as its listener: a progress bar, or some lines if this is not a terminal."""

    def __init__(self, training: Training, folder: Path) -> None:
        self.training, self.folder = training, folder
        self.console = Console(highlight=False)
        self._bar = GenerationBar(
            self.console, training.config.num_generations, by_chance=training.task.faults is not None
        )

    def on_stage(self, stage: Stage, message: str = "") -> None:
        """Say what is evolved before it begins, and show the bar until the evolution ends."""
        if stage == "starting":
            training, device = self.training, jax.default_backend().upper()
            self.console.print(
                f"[bold]{escape(training.task.title)}[/]\n"
                f"{_extent(training.config)}, "
                f"{len(training.vocabulary.leaves)} behaviors; "
                f"{training.settings.level}: {training.level.description} (JAX is on the {device})"
            )
            self._bar.start()
        elif stage != "evolving":
            self._bar.stop()

    def on_generation(self, history: Sequence[Generation], best_tree: Callable[[], Tree]) -> None:
        """Show a generation."""
        self._bar.update(history[-self.training.config.runs :])

    def finish(self, result: Result, session: Session) -> None:
        """Show the learnt tree and what is known of it."""
        self.console.print(Panel(Text(draw_text(result.tree).rstrip()), title="learnt tree", title_align="left"))
        folder, quoted = escape(str(self.folder)), escape(shlex.quote(str(self.folder)))
        if session.stopped:
            self.console.print(f"stopped after generation {result.generations}; go on with --resume {quoted}")
        training, test = self.training, result.test
        layouts, draws = training.settings.layouts_of(training.task), training.draws
        of_chance = f" and {draws} draws of chance" if draws > 1 else ""
        measured = f" ({sum(result.trees_measured):,} trees in {layouts} layouts{of_chance} each)"
        each = measured if layouts * draws > 1 else ""
        success = test.success_rate * len(test.solved)
        self.console.print(
            f"fitness      [bold]{result.fitness:.1f}[/]\n"
            f"success      [bold]{success:.0f} of {len(test.solved)}[/] {where_tested(test)}, "
            f"fitness there {test.fitness.mean():.1f} ± {test.fitness.std():.1f}\n"
            f"{faults_met(test)}{failures_met(test)}"
            f"evolution    {result.generations} generations, {sum(result.episodes):,} episodes{each}; this session "
            f"{session.seconds:.1f} s, {session.compile_seconds:.1f} s of it compiling\n"
            f"{self._simulated()}"
            f"results      {folder}",
            soft_wrap=True,
        )
        if test.failures:
            one = test.failures[0]
            draw = f" --draw {one.draws[0]}" if one.draws else ""
            self.console.print(
                f"watch one    python -m bt_jax.run {quoted} --layout {one.layouts[0]}{draw}", soft_wrap=True
            )
        if limit := self._limit(result):
            self.console.print(
                f"limit        {escape(limit)}; go on with --resume {quoted} --plan, or with a demonstration, which adds "
                "the place",
                soft_wrap=True,
            )
        elif not success:
            self.console.print(
                f"advice       go on with --resume {quoted} --generations {2 * result.generations}, or try another --seed, "
                "or --plan",
                soft_wrap=True,
            )
        elif len(prefix(result.tree)) > 1 + len(self.training.task.targets):
            self.console.print(f"simplify     python -m bt_jax.run {quoted} --simplify", soft_wrap=True)
        if not session.generations:
            self.console.print(
                f"unchanged    the run had ended; go on with --resume {quoted} --generations {result.generations + MORE}",
                soft_wrap=True,
            )
        if session.broken:
            self.warn(f"the simulation diverged {counted(session.broken, 'time')}; those trees got the worst fitness")

    def warn(self, problem: str) -> None:
        """Show what went wrong and did not end the run."""
        self.console.print(f"warning: {escape(problem)}", soft_wrap=True)

    def _limit(self, result: Result) -> str:
        """Return which targets the gene pool does not allow, if that is known; else an empty text."""
        search, learnt = self.training.evolution, result.checkpoint.state.knowledge
        if not isinstance(search, AchievementSearch) or not learnt:
            return ""
        missed = set.intersection(*(set(known.out_of_reach(search.goals).tolist()) for known in learnt))
        names = dict.fromkeys(self.training.task.targets[i].object for i in sorted(missed))
        if not names:
            return ""
        return f"no gene meets the target of {', '.join(names)}, and all were tried"

    def _simulated(self) -> str:
        if self.training.settings.evaluator != "table":
            return ""
        evaluator, table = self.training.evaluator, self.training.table
        restarts = counted(table.num_restarts, "time")
        full = f" (the table was full {restarts}; give it more --memory)" if table.num_restarts else ""
        hits = ""
        if isinstance(evaluator, AdaptiveEvaluator):
            hits = f", {evaluator.table.hit_rate:.0%} of those asked for were known"
            hits += ", so few that the table was given up" if evaluator.rolls_out else ""
        return (
            f"simulation   {table.num_transitions:,} distinct transitions{full}{hits}, "
            f"{table.settler.solved:,} simulated\n"
        )


def _extent(config: GPConfig) -> str:
    """Return how many trees a generation has, and how many generations there will be."""
    if config.method == "population":
        return f"population {config.population}, {config.num_generations} generations"
    most = "at most " if config.num_patience is not None else ""
    return f"{config.population} trees a generation, {most}{config.num_generations:,} generations"


def where_tested(test: Test) -> str:
    """Return what a test counts, with the interval of its success rate where chance has a part in it."""
    if test.struck is None:
        return "unseen layouts"
    low, high = test.interval
    return f"episodes in unseen layouts (95 %: {100 * low:.1f} to {100 * high:.1f} %)"


def faults_met(test: Test) -> str:
    """Return a line for each fault that happened: how many of these episodes are solved."""
    lines = [f"{PLURALS[name]}: {k} of {n}" for name, (k, n) in test.by_fault.items()]
    return f"faults       {', '.join(lines)}\n" if lines else ""


def failures_met(test: Test) -> str:
    """Return one line for each reason for which episodes are not solved, with their numbers; where things go wrong, for the
    COMMONEST."""
    lines: list[str] = []
    shown = test.failures if test.struck is None else test.failures[:COMMONEST]
    for group in shown:
        lines.append(
            f"{'failures' if not lines else '':12} {len(group.layouts)}: {escape(group.reason)} ({_where(group, test)})\n"
        )
    if rest := sum(len(group.layouts) for group in test.failures[len(shown) :]):
        lines.append(f"{'':12} {rest}: for other reasons\n")
    if test.unexplained:
        lines.append(f"{'':12} {test.unexplained}: not looked into (only the first {EXPLAINED} that fail are)\n")
    return "".join(lines)


def _where(group: Failures, test: Test) -> str:
    """Return the episodes that fail for a reason: layouts, or where things go wrong layouts and draws."""
    if len(group.layouts) == len(test.solved):
        return "every episode" if group.draws else "every layout"
    more = f" and {len(group.layouts) - LISTED} more" if len(group.layouts) > LISTED else ""
    if group.draws:
        pairs = zip(group.layouts[:LISTED], group.draws, strict=False)
        return f"layout.draw {', '.join(f'{layout}.{draw}' for layout, draw in pairs)}{more}"
    plural = "layouts" if len(group.layouts) > 1 else "layout"
    return f"{plural} {', '.join(map(str, group.layouts[:LISTED]))}{more}"
