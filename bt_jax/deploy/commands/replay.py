"""python -m bt_jax.deploy replay LOG: what happened, tick by tick, and whether the tree would decide the same again."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree, expand, not_memoryless, parse_behavior
from bt_jax.deploy.commands.arguments import ReplayArguments
from bt_jax.deploy.execution.decision import Look, Step, decide
from bt_jax.deploy.execution.log_reader import Damage, numbered_entries
from bt_jax.deploy.execution.observation import Observation, pose_from_list
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.recorded import program_of, statuses_of
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.execution.statuses import Context
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.interpret import TreeMemory
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix

__all__ = ["Replayed", "replay", "replay_command"]

STYLES = {Status.SUCCESS: "green", Status.FAILURE: "red", Status.RUNNING: "bold yellow", None: "dim"}


@dataclasses.dataclass(frozen=True)
class Replayed:
    """One tick of a log, decided again from what was known then. `phase`, what was done in a word, is None for logs that do
    not say what it depended on."""

    seen: Observation
    logged: tuple[Status | None, ...]
    statuses: tuple[Status | None, ...]
    logged_phase: str
    phase: str | None

    @property
    def same(self) -> bool:
        """Are all statuses, and what is done, as they were?"""
        return self.logged == self.statuses and self.phase in (None, self.logged_phase)


@dataclasses.dataclass(frozen=True)
class _Tick:
    """One intact line of a log about a tick that ticked the tree: what was known, and what was decided."""

    number: int  # of the line
    seen: Observation
    context: Context
    look: Look | None  # None for logs that do not say it
    now: float
    statuses: tuple[Status | None, ...]
    phase: str


def replay(path: Path) -> Iterator[Replayed]:
    """Tick the tree of a log again, with what was known at each tick that ticked it. Raise UserError at a damaged line."""
    damage = Damage(path, strict=True)
    entries = numbered_entries(path, damage)
    _, start = next(entries)
    program = program_of(start, path)
    yield from _replayed(program, start, _intact_ticks(program, entries, damage))


def _intact_ticks(program: Program, entries: Iterable[tuple[int, dict[str, Any]]], damage: Damage) -> Iterator[_Tick]:
    """Yield the ticks that ticked the tree; lines that say something else than the run wrote are noted as damaged."""
    nodes = len(prefix(expand(program.tree)))
    for number, entry in entries:
        if entry["kind"] == "tick" and entry["statuses"] is not None:
            tick = None
            with damage.noted(number):
                seen, statuses = Observation.from_dict(entry["seen"]), statuses_of(entry["statuses"])
                if len(statuses) != nodes:
                    raise ValueError(f"{len(statuses)} statuses of {nodes} nodes")
                context, now = _context(entry["context"], seen), entry.get("time", seen.time)
                tick = _Tick(number, seen, context, _look(entry), now, statuses, entry["phase"])
            if tick is not None:
                yield tick


def _replayed(program: Program, start: Mapping[str, Any], ticks: Iterable[_Tick]) -> Iterator[Replayed]:
    """Decide again at each tick, from the first one of a run on and without a gap if the tree has memory."""
    limits = dataclasses.asdict(Limits()) | start.get("limits", {})
    tree, memory, patience, period = expand(program.tree), TreeMemory(), limits["look"], limits["tick"]
    for tick in ticks:
        look = tick.look or Look()
        times = {"now": tick.now, "patience": patience, "tick": period}
        decision = decide(program, tree, tick.seen, tick.context, look, memory, **times)
        memory = decision.memory
        phase = None if tick.look is None else str(decision.step)
        if phase == Step.STARTING and start.get("dry"):
            phase = f"would start {decision.wanted}"
        yield Replayed(tick.seen, tick.statuses, decision.ticked.statuses, tick.phase, phase)


def replay_command(arguments: ReplayArguments, console: Console | None = None) -> int:
    """Print a log; return 0 if it replays as it was, 1 if the tree decides differently now. Damaged lines are left out, and
    named; so are the ticks after them if the tree has memory, since what it remembered then is not known. Raise UserError if
    no tick is left."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    damage = Damage(arguments.log, strict=False)
    entries = list(numbered_entries(arguments.log, damage))
    start = entries[0][1]
    program = program_of(start, arguments.log)
    ticks = list(_intact_ticks(program, entries, damage))
    gap = None if not_memoryless(program.tree) is None else min(damage.lines, default=None)
    replayed = list(_replayed(program, start, (tick for tick in ticks if gap is None or tick.number < gap)))
    intact = [entry for number, entry in entries if number not in damage.lines]
    console.print(f"tree       {program.digest[:12]}\nversions   {_listed(start.get('versions', {}))}", markup=False)
    _tell(intact, expand(program.tree), start, arguments.every, console)
    differing = sum(not tick.same for tick in replayed)
    console.print(f"\n{_summary(intact)}", markup=False)
    if damage.lines:
        console.print(f"damaged    line {damage}: left out", markup=False, style="red")
    if len(replayed) < len(ticks):
        console.print(
            f"left out   {len(ticks) - len(replayed)} ticks after line {gap}: not comparable, since the tree has memory and "
            "what it remembered is not known",
            style="red",
        )
    if not replayed:
        raise UserError(
            f"no tick of {arguments.log} can be replayed; give the undamaged log of a run that ticked its tree"
        )
    console.print(f"replayed   {len(replayed)} ticks, {len(replayed) - differing} decided as they were")
    return 1 if differing else 0


def _tell(
    entries: Sequence[Mapping[str, Any]], tree: Tree, start: Mapping[str, Any], every: bool, console: Console
) -> None:
    """Print what happened: `every` tick, or only those in which a status changed."""
    previous, began, found = None, start.get("time", 0.0), list[str]()
    for entry in entries:
        if entry["kind"] == "tick":
            shown = (entry["statuses"], entry["phase"])
            if entry["statuses"] is not None:
                before, found = found, [text for _, text, *_ in entry["seen"].get("findings", ())]
                for text in found:
                    if text not in before:
                        console.print(f"{entry['seen']['time'] - began:8.2f} s  seen: {text}", markup=False)
            if entry["statuses"] is not None and (every or shown != previous):
                time = entry["seen"]["time"] - began
                holding = entry["seen"]["holding"] or "nothing"
                console.print(f"\n{time:8.2f} s  {entry['phase']}, holding {holding}", markup=False)
                console.print(_drawing(tree, statuses_of(entry["statuses"])))
            previous = shown
        elif entry["kind"] == "action":
            reason = f": {entry['reason']}" if entry["reason"] else ""
            console.print(f"{entry['time'] - began:8.2f} s  {entry['action']} {entry['event']}{reason}", markup=False)
        elif entry["kind"] == "disturbance":
            console.print(
                f"{entry['time'] - began:8.2f} s  {entry['what']} {entry['box']}", markup=False, style="magenta"
            )
        elif entry["kind"] == "exception":
            console.print(entry["text"], markup=False, style="red")


def _summary(entries: list[dict[str, Any]]) -> str:
    """Return how it ended, and how well the arms followed."""
    lines = []
    lags = [
        np.abs(np.array(entry["setpoint"], float) - np.array(entry["measured"], float)).ravel()
        for entry in entries
        if entry["kind"] == "motion"
    ]
    known = [lag for lag in np.concatenate([[], *lags]) if np.isfinite(lag)]
    if known:
        lines.append(f"motion     largest distance of a joint from its setpoint {np.degrees(max(known)):.2f} deg")
    end = entries[-1]
    if end["kind"] != "end":
        return "\n".join([*lines, "end        the log breaks off: the program was killed"])
    counted = ", ".join(f"{value} {name}" for name, value in end.get("counters", {}).items())
    lines.append(f"link       {counted}")
    lines.append(f"ticks      {end.get('ticks')}, {end.get('overruns')} too slow")
    lines.append(f"end        {end.get('reason')} after {end.get('seconds', 0.0):.1f} s (exit code {end['exit_code']})")
    return "\n".join(lines)


def _context(data: Mapping[str, Any], seen: Observation) -> Context:
    """Return the context of a tick. Older logs do not say where things were that were not seen."""
    last = None
    if "last" in data:
        last = {**{name: pose_from_list(values) for name, values in data["last"].items()}, **seen.poses}
    return Context(
        attempt=None if data["attempt"] is None else parse_behavior(data["attempt"]),
        exhausted=frozenset(map(parse_behavior, data["exhausted"])),
        reached=frozenset(data["reached"]),
        unreachable=frozenset(data["unreachable"]),
        last=last,
    )


def _look(entry: Mapping[str, Any]) -> Look | None:
    """Return the look of a tick, None for older logs, which do not say it."""
    data = entry.get("sight")
    if data is None:
        return None
    return Look(data["looking"], data["looked"], frozenset(map(parse_behavior, data["undecided"])))


def _drawing(tree: Any, statuses: tuple[Status | None, ...]) -> Text:
    lines = draw_text(tree, statuses).splitlines()
    return Text("\n").join(Text(line, STYLES[status]) for line, status in zip(lines, statuses, strict=True))


def _listed(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())
