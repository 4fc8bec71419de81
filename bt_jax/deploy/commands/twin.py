"""python -m bt_jax.deploy twin: run a tree on the twin, show it live, film it; or run it in many layouts."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import track
from rich.text import Text

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.statistics import wilson
from bt_jax.deploy.commands.arguments import DEFAULT_TASK, TwinArguments
from bt_jax.deploy.commands.display import RunDisplay
from bt_jax.deploy.commands.serve import serve_twin
from bt_jax.deploy.execution.program import Program, load_program
from bt_jax.deploy.execution.settings import TWIN_SECONDS, Exit, Limits
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.cell_view import CellView
from bt_jax.deploy.twin.fault_injector import check_faults
from bt_jax.deploy.twin.run import TwinRun, TwinTick, run_twin
from bt_jax.deploy.twin.settings import Realism
from bt_jax.mjx_env.render.offscreen import write_film
from bt_jax.tasks import load_faults, with_faults

__all__ = ["survey", "twin_command"]

SIZE = (800, 450)  # of a film
FPS, FASTER = 30, 3  # a film shows what was seen at each tick, 10 a second, three times as fast
STILLS = 6


def twin_command(arguments: TwinArguments, console: Console | None = None) -> int:
    """Run and print; return an exit code, see `Exit`."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    if arguments.serve or arguments.source is None:
        return serve_twin(arguments, console)
    program = load_program(arguments.source, arguments.task, otherwise=DEFAULT_TASK)
    if arguments.faults is not None:
        task = with_faults(program.task, load_faults(arguments.faults), source=f"--faults {arguments.faults}")
        program = dataclasses.replace(program, task=task)
    check_faults(program.task, realtime=arguments.realtime)
    if arguments.draw > 1 and program.task.faults is None:
        raise UserError("--draw is of what goes wrong, and nothing does in this task; add --faults")
    name = (
        arguments.log
        or Path("runs") / f"twin-{time.strftime('%Y%m%d-%H%M%S')}{'' if arguments.layouts > 1 else '.jsonl'}"
    )
    if arguments.layouts > 1:
        seeds = range(arguments.seed, arguments.seed + arguments.layouts)
        touches = arguments.touches if arguments.disturb else 0
        runs = survey(
            program,
            seeds,
            disturbances=touches,
            realtime=arguments.realtime,
            seconds=arguments.seconds,
            realism=arguments.realism,
            draw=arguments.draw - 1,
            folder=name,
            console=console,
        )
        return overall_exit_code(run.exit_code for run in runs)
    return _single(program, arguments, name, console)


def overall_exit_code(codes: Iterable[int]) -> int:
    """Return DONE if all runs were, STOPPED if one ended in a protective stop, else FAILED."""
    codes = set(codes)
    if codes <= {Exit.DONE}:
        return Exit.DONE
    return Exit.STOPPED if Exit.STOPPED in codes else Exit.FAILED


def survey(
    program: Program,
    seeds: Iterable[int],
    *,
    disturbances: int = 0,
    realtime: bool = False,
    seconds: float = TWIN_SECONDS,
    realism: Realism | None = None,
    draw: int = 0,
    folder: Path | None = None,
    console: Console,
) -> list[TwinRun]:
    """Run a tree in many layouts, a line for each, and say how often it succeeds; with a `folder`, logs and a summary."""
    runs = []
    for seed in seeds:
        log = None if folder is None else folder / f"layout-{seed}.jsonl"
        run = run_twin(
            YUMI,
            program,
            seed,
            disturbances=disturbances,
            realtime=realtime,
            log=log,
            limits=Limits(run=seconds),
            realism=realism,
            draw=draw,
        )
        runs.append(run)
        console.print(_line(run))
        if run.exit_code == Exit.INTERRUPTED:
            raise KeyboardInterrupt
        if folder is not None:
            write_atomic(folder / "summary.json", json.dumps([_summary(each) for each in runs], indent=2) + "\n")
    count = sum(run.exit_code == Exit.DONE for run in runs)
    low, high = wilson(count, len(runs))
    between = f"95 % interval {100 * low:.0f} to {100 * high:.0f} %"
    console.print(f"success    [bold]{count} of {len(runs)}[/] layouts ({between})")
    console.print(f"robot      {np.mean([run.outcome.seconds for run in runs]):.1f} s a run in the mean")
    if folder is not None:
        console.print(f"logs       {escape(str(folder))}")
    return runs


def _single(program: Program, arguments: TwinArguments, log: Path, console: Console) -> int:
    states: list[np.ndarray] = []
    with RunDisplay(program, console) as display:

        def tick(moment: TwinTick) -> None:
            states.append(moment.qpos)
            display.update(moment.shown, "" if moment.touch is None else str(moment.touch))

        run = run_twin(
            YUMI,
            program,
            arguments.seed,
            realtime=arguments.realtime,
            disturbances=arguments.touches if arguments.disturb else 0,
            log=log,
            limits=Limits(run=arguments.seconds),
            on_tick=tick,
            realism=arguments.realism,
            draw=arguments.draw - 1,
        )
    console.print(_verdict(program, run))
    console.print(f"log        {escape(str(log))}")
    if arguments.render is not None:
        _film(program, arguments.seed, states, arguments.render, console)
        console.print(f"film       {escape(str(arguments.render))}, {FASTER} times as fast")
    return run.exit_code


def _verdict(program: Program, run: TwinRun) -> Text:
    outcome, task = run.outcome, program.task
    parts: list[str | tuple[str, str]] = [f"end        {outcome.reason} after {outcome.seconds:.1f} s\n"]
    for target, distance in zip(task.targets, run.distances, strict=True):
        mark = ("✓", "green") if distance < task.episode.tolerance else ("✗", "red")
        parts += ["target     ", mark, f" {target.object} {1000 * distance:.1f} mm from its place in {target.frame}\n"]
    parts.append(
        f"cycles     {run.stats.cycles}, {run.stats.missed} missed; link {run.counters.late} late, "
        f"{run.counters.lost} lost, {run.counters.clipped} clipped, {run.counters.rejected} rejected\n"
        f"ticks      {outcome.ticks}, {outcome.overruns} too slow; {run.seconds:.1f} s by the clock\nsolved     "
    )
    parts.append(("yes", "bold green") if run.exit_code == Exit.DONE else ("no", "bold red"))
    return Text.assemble(*parts)


def _line(run: TwinRun) -> Text:
    good = run.exit_code == Exit.DONE
    touched = f"  {'; '.join(map(str, run.touches))}" if run.touches else ""
    worst = 1000 * max(run.distances)
    return Text.assemble(
        f"layout {run.seed:4d}  ",
        ("✓" if good else "✗", "green" if good else "red"),
        f" {run.outcome.seconds:6.1f} s  worst {worst:5.1f} mm  {run.outcome.reason}{touched}",
    )


def _summary(run: TwinRun) -> dict:
    return {
        **dataclasses.asdict(run),
        "outcome": {**dataclasses.asdict(run.outcome), "status": run.outcome.status.name},
    }


def _film(program: Program, seed: int, states: list[np.ndarray], path: Path, console: Console) -> None:
    view = CellView(build_scene(YUMI, program.task, seed), width=SIZE[0], height=SIZE[1])
    frames = []
    if path.suffix.lower() == ".png":
        states = [states[round(i)] for i in np.linspace(0, len(states) - 1, STILLS)]
    try:
        for qpos in track(states, "filming", console=console, transient=True, disable=not console.is_terminal):
            frames.append(view(qpos))
    finally:
        view.close()
    write_film(path, frames, FPS)
