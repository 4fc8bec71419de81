"""What `python -m bt_jax.run` does: execute a saved Behavior Tree in simulation, show it tick by tick, film it."""

from __future__ import annotations

import math
import time

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.markup import escape
from rich.progress import Progress
from rich.text import Text

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Behavior, Tree, Vocabulary, expand
from bt_jax.commands.arguments import RunArguments
from bt_jax.deploy.commands.arguments import TwinArguments
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text, to_dot
from bt_jax.encoding.formats.files import check_tree, read_tree
from bt_jax.encoding.formats.text import format_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import leaves, prefix
from bt_jax.mjx_env.episodes.diagnosis import explain_failure
from bt_jax.mjx_env.episodes.playback import Playback, Tick, play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.faults.fates import Fates, joined, sample_episodes, sample_fates
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.render.film import check_film, film
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, concatenate
from bt_jax.tasks import Task, load_faults, load_task, task_of_folder, with_faults
from bt_jax.training.console import failures_met, faults_met, where_tested
from bt_jax.training.levels import make_level
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import UNSEEN, Backend, Level, Settings
from bt_jax.training.simplify import simplify
from bt_jax.training.testing import as_test, episode_of_test, explained

__all__ = ["robot", "run"]

STYLES = {Status.SUCCESS: "green", Status.FAILURE: "red", Status.RUNNING: "bold yellow", None: "dim"}
WORDS = {
    "open_gripper": "opens the gripper",
    "close_gripper": "closes the gripper",
    "pick": "picks {object}",
    "place": "places {object} at {position} in the frame of {frame}",
    "look": "looks for {object}",
    "approach": "drives towards {object}",
}
EXPORTS = {".txt": format_tree, ".xml": to_xml, ".svg": to_svg, ".dot": to_dot}
LISTED = 20  # failures
SIMPLIFY_LAYOUTS = 100


def robot(arguments: RunArguments, console: Console | None = None) -> int:
    """Run the tree on the twin of a YuMi and return the twin's exit code. Raise UserError if what the twin needs is not
    installed."""
    _check(arguments)
    try:
        from bt_jax.deploy.commands.twin import twin_command  # heavy: only the robot needs these
    except ModuleNotFoundError as error:
        raise UserError(f'{error.name} is not installed; run pip install -e ".[robot]"') from error
    twin = TwinArguments(
        arguments.source,
        arguments.task,
        faults=arguments.faults,
        draw=1 if arguments.draw is None else arguments.draw,
        seed=arguments.seed,
        layouts=arguments.layouts,
        render=arguments.render,
    )
    return twin_command(twin, console)


def run(arguments: RunArguments, console: Console | None = None) -> None:
    """Do what the arguments say and print it."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    _check(arguments)
    task, level, tree = _open(arguments)
    configure_jax(arguments.device)
    if arguments.simplify:
        tree = _simplified(console, task, level, tree, arguments)
    written = expand(tree)
    known = Vocabulary.of([*leaves(tree), *leaves(written)])
    semantics, physics = LeafSemantics(task, known), _physics(task, level, arguments.backend)
    if arguments.export is not None:
        export = EXPORTS[arguments.export.suffix.lower()]
        write_atomic(arguments.export, export(written if arguments.expand else tree))
        console.print(f"written    {escape(str(arguments.export))}")
        if arguments.layouts == 1 and arguments.render is None and not arguments.verbose:
            return
    console.print(f"[bold]{escape(task.title)}[/]\n{level}: {physics.description}")
    if arguments.test:
        _test(console, semantics, physics, tree, arguments)
        return
    if arguments.layouts > 1:
        _survey(console, semantics, physics, tree, arguments)
        return
    settler, (layout, fate) = Settler(task, physics), _chosen_episode(task, arguments)
    playback = play(semantics, settler, tree, layout, fate)
    shown = play(semantics, settler, written, layout, fate) if arguments.expand else playback
    _show(console, shown, delay=arguments.delay, whole=arguments.verbose)
    console.print(_verdict(task, playback))
    if arguments.render is not None:
        with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
            job = bar.add_task(f"filming {arguments.render}", total=1.0)
            film(arguments.render, semantics, playback, progress=lambda part: bar.update(job, completed=part))
        console.print(f"film       {arguments.render}")


def _check(arguments: RunArguments) -> None:
    """Raise UserError for arguments that cannot work."""
    arguments.check()
    if arguments.export is not None and arguments.export.suffix.lower() not in EXPORTS:
        raise UserError(f"{arguments.export} is no kind of tree file; let its name end in {', '.join(EXPORTS)}")
    if arguments.render is not None:
        check_film(arguments.render)


def _open(arguments: RunArguments) -> tuple[Task, Level, Tree]:
    """Return what to run and how: arguments come before what a folder says."""
    assert arguments.level != "robot"
    task, level = None, arguments.level
    if (arguments.source / "config.json").is_file():
        folder = RunFolder(arguments.source)
        config = folder.config()
        folder.tree()  # says how to finish a run that has none yet
        task, level = config.task, level or config.settings.level
    elif arguments.source.is_dir() and arguments.task is None:
        task = task_of_folder(arguments.source)
    if task is None or arguments.task is not None:
        task = load_task(arguments.task or "stack")
    if arguments.faults is not None:
        task = with_faults(task, load_faults(arguments.faults), source=f"--faults {arguments.faults}")
    if arguments.draw is not None and task.faults is None:
        raise UserError("--draw is of what goes wrong, and nothing does in this task; add --faults")
    tree = read_tree(arguments.source)
    check_tree(tree, task, arguments.source)
    return task, level or "physics", tree


def _simplified(console: Console, task: Task, level: Level, tree: Tree, arguments: RunArguments) -> Tree:
    """Return the tree without what does nothing; say what was removed, and write it beside the learnt one."""
    seed = [UNSEEN, arguments.seed]
    layouts, fates = sample_episodes(task, seed, layouts=SIMPLIFY_LAYOUTS, draws=Settings().draws_of(task))
    found = simplify(task, _physics(task, level, arguments.backend), tree, layouts, fates)
    console.print(f"simplified {found.removed} of {len(prefix(tree))} nodes do nothing in {SIMPLIFY_LAYOUTS} layouts")
    if found.removed and arguments.source.is_dir():
        paths = RunFolder(arguments.source).save_simplified(found.tree, title=f"{task.name}, simplified")
        console.print(f"written    {escape(', '.join(map(str, paths)))}")
    return found.tree


def _physics(task: Task, level: Level, backend: Backend) -> Physics:
    if level == "physics" and backend == "auto":
        return MujocoPhysics(task)
    return make_level(task, Settings(level=level, backend=backend))


def _layout(task: Task, seed: int) -> World:
    return sample_layouts(task, [UNSEEN, seed], 1)


def _chosen_episode(task: Task, arguments: RunArguments) -> tuple[World, Fates | None]:
    """Return the layout that the arguments name, and the fate of the episode there if things go wrong."""
    if arguments.layout is None:
        return _layout(task, arguments.seed), _fate(task, [UNSEEN, arguments.seed], arguments)
    config = _tested(arguments, "--layout numbers the layouts that a run was tested in")
    return episode_of_test(task, config, arguments.layout, arguments.draw or 1)


def _fate(task: Task, seed: list[int], arguments: RunArguments) -> Fates | None:
    """Return the fate of the draw that the arguments name, in the first layout of a seed."""
    draw = (arguments.draw or 1) - 1
    return sample_fates(task, seed, layouts=range(1), draws=range(draw, draw + 1))


def _tested(arguments: RunArguments, purpose: str) -> RunConfig:
    """Return the configuration of the run folder. Raise UserError if the arguments name none."""
    if not (arguments.source / "config.json").is_file():
        raise UserError(f"{purpose}; name a run folder, or choose a --seed")
    return RunFolder(arguments.source).config()


def _test(console: Console, semantics: LeafSemantics, physics: Physics, tree: Tree, arguments: RunArguments) -> None:
    """Run the tree in the layouts and draws of the run's test, and print how it fares and why it fails."""
    config = _tested(arguments, "--test takes the layouts that a run was tested in")
    task, settings = semantics.task, config.settings
    draws = settings.draws_of(task)
    layouts, fates = sample_episodes(task, [UNSEEN, config.gp.seed], layouts=settings.test_layouts, draws=draws)
    test = as_test(survey(semantics, physics, tree, layouts, fates), len(layouts.held), draws=draws)
    test = explained(test, semantics, Settler(task, physics), tree, layouts, fates)
    console.print(
        f"success      [bold]{test.solved.sum()} of {len(test.solved)}[/] {where_tested(test)}, "
        f"fitness there {test.fitness.mean():.1f} ± {test.fitness.std():.1f}\n"
        f"{faults_met(test)}{failures_met(test)}".rstrip()
    )


def _survey(console: Console, semantics: LeafSemantics, physics: Physics, tree: Tree, arguments: RunArguments) -> None:
    """Run the tree in many layouts and print how it fares."""
    task = semantics.task
    seeds = range(arguments.seed, arguments.seed + arguments.layouts)
    layouts = concatenate([_layout(task, seed) for seed in seeds])
    fates = [fate for seed in seeds if (fate := _fate(task, [UNSEEN, seed], arguments)) is not None]
    result = survey(semantics, physics, tree, layouts, joined(fates) if fates else None)
    solved, values = result.solved[0], result.values[0]
    console.print(
        f"success    [bold]{solved.sum()} of {len(solved)}[/] layouts ({100 * solved.mean():.0f} %)\n"
        f"fitness    {values.mean():.1f} ± {values.std():.1f}"
    )
    if result.travel is not None:
        console.print(f"driven     {result.travel.mean():.1f} m, mean")
    failures = np.flatnonzero(~solved)
    for k in failures[:LISTED]:
        away = [
            f"{t.object} {1000 * d:.0f} mm" for t, d in zip(task.targets, result.misses.distance[0, k], strict=True)
        ]
        ending = Ending(int(result.ending[0, k])).name
        console.print(f"[red]✗[/] seed {seeds[k]}: {ending} at tick {result.ticks[0, k]}, {', '.join(away)} off")
    if len(failures) > LISTED:
        console.print(f"and the seeds {', '.join(str(seeds[k]) for k in failures[LISTED:])}")
    if len(failures):
        console.print(f"watch one with --seed {seeds[failures[0]]}")


def _show(console: Console, playback: Playback, *, delay: float, whole: bool) -> None:
    """Show the tree at every tick: on a terminal in one place with pauses, else the `whole` tree or what has changed."""
    titles = [_title(number, tick) for number, tick in enumerate(playback.ticks, start=1)]
    drawings = [_drawing(playback.tree, tick) for tick in playback.ticks]
    wrong = [[Text(f"         {trouble}", "magenta") for trouble in tick.troubles] for tick in playback.ticks]
    if not console.is_terminal or console.is_dumb_terminal:
        before: list[Text] = []
        for title, lines, troubles in zip(titles, drawings, wrong, strict=True):
            console.print(title)
            for i, line in enumerate(lines):
                if whole or not before or line != before[i]:
                    console.print(line)
            for trouble in troubles:
                console.print(trouble)
            before = lines
        console.print()
        return
    with Live(console=console, auto_refresh=False) as live:
        for title, lines, troubles in zip(titles, drawings, wrong, strict=True):
            live.update(Group(title, *lines, *troubles), refresh=True)
            time.sleep(delay)
            if title is not titles[-1]:
                live.console.print(title, *troubles, sep="\n")


def _title(number: int, tick: Tick) -> Text:
    """Return what the tree returned, and what the robot does."""
    return Text.assemble(f"tick {number:2d}  ", (tick.status.name, STYLES[tick.status]), f"  {_words(tick.command)}")


def _drawing(tree: Tree, tick: Tick) -> list[Text]:
    """Return one line for each node, marked with its status."""
    lines = draw_text(tree, tick.statuses).splitlines()
    return [Text(line, STYLES[status]) for line, status in zip(lines, tick.statuses, strict=True)]


def _words(command: Behavior | None) -> str:
    """Say what the robot does."""
    if command is None:
        return "does nothing"
    position = None if command.position is None else f"({', '.join(f'{x:g}' for x in command.position)})"
    words = WORDS[command.name].format(object=command.object, position=position, frame=command.frame)
    if command.name == "approach" and position is not None:
        return f"drives towards {position} in the frame of {command.object}"
    return words if command.turn is None else f"{words}, turned by {command.turn:g} degrees"


def _verdict(task: Task, playback: Playback) -> Text:
    """Say how an episode ended."""
    word, style = ("yes", "bold green") if playback.solved else ("no", "bold red")
    parts: list[str | tuple[str, str]] = [f"ending     {playback.ending.name} at tick {len(playback.ticks)}\n"]
    misses = playback.misses
    for target, distance, turn, met in zip(task.targets, misses.distance, misses.turn, misses.met, strict=True):
        mark = ("✓", "green") if met else ("✗", "red")
        turned = "" if target.turn is None else f", turned {math.degrees(turn):.1f} degrees off"
        place = target.slot or f"its place in {target.frame}"
        parts += ["target     ", mark, f" {target.object} {1000 * distance:.1f} mm from {place}{turned}\n"]
    if task.robot.base is not None:
        parts.append(f"driven     {playback.travel:.1f} m\n")
    parts += [f"fitness    {playback.fitness:.1f}\nsolved     ", (word, style)]
    return Text.assemble(*parts, "" if playback.solved else f", {explain_failure(task, playback)}")
