"""What `python -m bt_jax.demonstrate --watch` does: a camera watches a person, in a cell, in a film or in the twin."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import select
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import MappingProxyType

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.markup import escape
from rich.text import Text

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted
from bt_jax.commands.arguments import DemonstrateArguments
from bt_jax.deploy.commands.arguments import DEFAULT_TASK
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera import Camera
from bt_jax.deploy.perception.camera_file import load_camera, save_camera
from bt_jax.deploy.perception.film import Recorder, pictures_in
from bt_jax.deploy.perception.opening import open_camera
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.demonstrator import Demonstrator
from bt_jax.deploy.twin.filmed import FilmedDemonstration
from bt_jax.lfd import Demonstration, DemonstrationFolder, Frames
from bt_jax.lfd.clustering import NEEDED
from bt_jax.tasks import Task, load_task
from bt_jax.teaching.script import DEMONSTRATED
from bt_jax.teaching.watch.looking import Looking
from bt_jax.teaching.watch.moves import Decision, Doubt, Watched
from bt_jax.teaching.watch.recording import demonstration_of
from bt_jax.teaching.watch.rest import WatchSettings
from bt_jax.teaching.watch.session import watch_demonstration
from bt_jax.teaching.watch.sighting import Sighting
from bt_jax.teaching.watch.watcher import Event, Watcher

__all__ = ["watch"]

Calibration = tuple[Intrinsics, CameraPose]
OWN = "camera.yaml"  # of a recorded film: lens and place of its camera
TWIN_FPS = 10.0  # images a second of the twin's film
STYLES = MappingProxyType({"moving": "cyan", "stands": "green", "back": "dim", "doubt": "yellow"})
ANSWERS: MappingProxyType[str, Decision] = MappingProxyType({"k": "keep", "l": "leave out", "a": "again"})
CHOICES = MappingProxyType(  # kind of a doubt -> what keeping and leaving out mean
    {
        "together": ("keep both moves", "leave out both"),
        "twice": ("keep both moves", "leave out the first"),
        "bumped": ("keep it as a move", "leave it out, it was no action"),
        "lost": ("keep the demonstration, as if it were where it was last at rest", "leave out the demonstration"),
    }
)


@dataclasses.dataclass(frozen=True)
class _Source:
    """Where one demonstration is watched: `open` returns a camera with its lens and place, each time another one where
    `repeats`. `live`: a person is there, and the demonstration ends once they do nothing more."""

    title: str
    open: Callable[[], tuple[Camera, Intrinsics, CameraPose]]
    repeats: bool = True
    live: bool = False
    layout: int | None = None  # of the twin


def watch(arguments: DemonstrateArguments) -> None:
    """Watch as the arguments say, print what is seen, and keep each demonstration as soon as it is whole. Raise UserError if
    none is kept."""
    console = Console(highlight=False, soft_wrap=True)
    folder = DemonstrationFolder(arguments.folder)
    kept = folder.task() if arguments.folder.is_dir() else None
    task = load_task(arguments.task) if arguments.task is not None else kept or load_task(DEFAULT_TASK)
    count, problem = 0, ""
    try:
        for number, source in enumerate(_sources(arguments, task, folder)):
            one = _watch_one(console, source, task, arguments, first=number == 0)
            if isinstance(one, str):
                problem = one
                console.print(f"[yellow]not kept: {escape(problem)}[/]")
                continue
            if not count:
                folder.create(Frames.of(task))
            if source.layout is not None:
                folder.use_layouts(source.layout + 1)
            named = folder.append(one)
            count += 1
            console.print(f"{escape(str(folder.path / named.name))}: {counted(len(named.actions), 'action')}")
    except (KeyboardInterrupt, EOFError):
        console.print("stopped; what was kept stays")
    if not count:
        raise UserError(f"no demonstration was kept: {problem or 'none was shown'}")
    if (total := len(folder.names())) < NEEDED:
        console.print(
            f"{total} of {NEEDED} demonstrations: with fewer, every place is taken to be in {task.robot_frame}"
        )
    console.print(f"learn from them with python -m bt_jax.learn {escape(shlex.quote(str(folder.path)))}")


def _sources(arguments: DemonstrateArguments, task: Task, folder: DemonstrationFolder) -> Iterator[_Source]:
    """Yield one source for each demonstration."""
    name, fps = str(arguments.camera), arguments.fps
    if name == "twin":
        first = folder.next_layout() if arguments.seed is None else arguments.seed
        for number in range(first, first + arguments.count):
            film = functools.partial(_twin, task, [DEMONSTRATED, number], itertools.count(), fps or TWIN_FPS)
            yield _Source(f"twin, layout {number}", film, layout=number)
        return
    given = None if arguments.calibration is None else load_camera(arguments.calibration)
    if Path(name).is_dir():
        inner = [] if pictures_in(Path(name)) else sorted(path for path in Path(name).iterdir() if path.is_dir())
        for path in inner or [Path(name)]:
            yield _Source(str(path), functools.partial(_film, path, given, fps), repeats=False)
        return
    for number in range(1, arguments.count + 1):
        title = f"demonstration {number} of {arguments.count}; Enter or Ctrl-C ends it"
        yield _Source(title, functools.partial(_camera, name, given), live=True)


def _camera(name: str, given: Calibration | None) -> tuple[Camera, Intrinsics, CameraPose]:
    assert given is not None
    return open_camera(name, given[0]), *given


def _film(folder: Path, given: Calibration | None, fps: float | None) -> tuple[Camera, Intrinsics, CameraPose]:
    """Return the camera that plays a film, with the given lens and place, else those that were kept with it."""
    own = folder / OWN
    if given is None and not own.is_file():
        raise UserError(
            f"{folder} does not tell lens and place of its camera; give --calibration with the file that python -m "
            "bt_jax.deploy calibrate writes"
        )
    lens, place = given or load_camera(own)
    return open_camera(str(folder), lens, fps=fps, realtime=False), lens, place


def _twin(task: Task, seed: list[int], attempts: Iterator[int], fps: float) -> tuple[Camera, Intrinsics, CameraPose]:
    """Return the camera that films a person in the twin's cell, doing what the task's targets say, and otherwise in each of
    the `attempts`."""
    scene = build_scene(YUMI, task, seed)
    person = Demonstrator(scene, task.targets, np.random.default_rng([*seed, next(attempts)]))
    return FilmedDemonstration(scene, person, fps=fps, seed=seed), *scene.calibration


def _watch_one(
    console: Console, source: _Source, task: Task, arguments: DemonstrateArguments, *, first: bool
) -> Demonstration | str:
    """Watch until a demonstration is not to be shown again. Return it, or why it is left out. Unless it is the `first`, a
    person has to put the boxes back before it, and so before it is shown again."""
    while True:
        if source.live and not first and sys.stdin.isatty():
            console.input("put the boxes where the next demonstration begins, then press Enter (Ctrl-C ends) ")
        first = False
        console.print(f"[bold]{escape(source.title)}[/]")
        camera, lens, place = source.open()
        if arguments.record is not None:
            kept = _unused(arguments.record)
            save_camera(kept / OWN, lens, place)
            camera = Recorder(camera, kept)
        settings = WatchSettings(idle=arguments.idle if source.live else math.inf)
        try:
            watched = _watched(console, Looking(task, camera, place.pose), Watcher(task, settings), live=source.live)
        finally:
            camera.close()
        decisions = [_decide(console, doubt, arguments.unclear, again=source.repeats) for doubt in watched.doubts]
        if "again" not in decisions:
            try:
                return demonstration_of(watched, decisions, task)
            except UserError as error:
                return str(error)


def _watched(console: Console, looking: Looking, watcher: Watcher, *, live: bool) -> Watched:
    """Watch one demonstration and show what is seen."""
    began = math.nan

    with Live(console=console, auto_refresh=False, transient=True) as display:
        if not console.is_terminal:
            display.stop()

        def say(event: Event) -> None:
            console.print(Text(f"{_since(began, event.time):7.1f} s  {event.text}", STYLES.get(event.kind, "bold")))

        def show(sighting: Sighting) -> None:
            nonlocal began
            began = sighting.time if math.isnan(began) else began
            if console.is_terminal:
                missing = ", ".join(watcher.missing)
                seen = f"waiting for {missing} to rest in sight" if missing else "everything is at rest"
                display.update(Text(f"{_since(began, sighting.time):7.1f} s  {seen}", "dim"), refresh=True)

        return watch_demonstration(looking, watcher, say=say, show=show, ended=_entered if live else lambda: False)


def _since(began: float, now: float) -> float:
    return 0.0 if math.isnan(began) or not math.isfinite(now) else now - began


def _entered() -> bool:
    """Was Enter pressed? Where the terminal does not tell, Ctrl-C ends a demonstration."""
    if not sys.stdin.isatty():
        return False
    try:
        ready = bool(select.select([sys.stdin], [], [], 0)[0])
    except (OSError, ValueError):  # as on Windows
        return False
    return ready and sys.stdin.readline() is not None


def _decide(console: Console, doubt: Doubt, unclear: str, *, again: bool) -> Decision:
    """Return what is decided about a doubt: by a person if there is one to ask, else as the option says. `again`: it can be
    shown again."""
    keep, leave_out = CHOICES[doubt.kind]
    if unclear == "ask" and sys.stdin.isatty():  # somebody can be asked
        answers = {key: decision for key, decision in ANSWERS.items() if again or decision != "again"}
        usual = next(key for key, decision in answers.items() if decision == doubt.usual)
        console.print(f"[yellow]{escape(doubt.text)}[/]: k {keep}, l {leave_out}{', a show it again' if again else ''}")
        while True:
            try:
                question = "k, l or a?" if again else "k or l?"
                answer = console.input(f"{question} \\[{usual}] ").strip().lower() or usual
            except (KeyboardInterrupt, EOFError):
                answer = usual
            if answer in answers:
                return answers[answer]
    decision: Decision = {"keep": "keep", "leave-out": "leave out"}.get(unclear, doubt.usual)  # type: ignore[assignment]
    console.print(f"{escape(doubt.text)}: {keep if decision == 'keep' else leave_out}")
    return decision


def _unused(folder: Path) -> Path:
    """Return the first of FOLDER/film1, FOLDER/film2, ... that is not there."""
    return next(film for i in itertools.count(1) if not (film := folder / f"film{i}").exists())
