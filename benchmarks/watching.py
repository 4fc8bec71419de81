"""Does watching a person teach the right tree? A person demonstrates in the twin by hand, filmed; three demonstrations are a
series, from which a tree is learnt on the ordinary path. Then the trees run on the twin.

The films of `held out` come from another camera, in other light, of another hand, with more noise and blur; nothing of the
detection or the watching was tuned on them.

python -m benchmarks.watching films [--series 20] [--held-out 10] [--factor 1.5] [--jobs 2]
python -m benchmarks.watching twin [--layouts 20] [--jobs 2]
"""

from __future__ import annotations

import dataclasses
import os
import re
import tempfile
from collections import Counter
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any, Literal

os.environ.setdefault("MUJOCO_GL", "egl")

import numpy as np
import tyro
from rich.console import Console
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks._report import RESULTS, report
from benchmarks._survey import accumulated, code_digest, digest_of, stored
from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import Exit, Limits
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import TwinScene, build_scene
from bt_jax.deploy.twin.demonstrator import Demonstrator, Manner
from bt_jax.deploy.twin.filmed import FilmedDemonstration, Light
from bt_jax.deploy.twin.person_hand import HandModel
from bt_jax.deploy.twin.rendered_camera import CameraPlacement
from bt_jax.deploy.twin.run import run_twin
from bt_jax.deploy.twin.settings import Realism
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.lfd import DemonstrationFolder, Frames, Lesson, learn, plan_task
from bt_jax.tasks import Task, load_task
from bt_jax.teaching.watch.looking import Looking
from bt_jax.teaching.watch.recording import demonstration_of
from bt_jax.teaching.watch.session import watch_demonstration
from bt_jax.teaching.watch.watcher import Watcher

TASKS = ("yumi_stack", "benchmarks/tasks/yumi_pyramid.yaml")
DEMONSTRATIONS = 3  # in a series
SHOWN = 3  # times at most that one is shown
SEED = 1 << 22  # of layouts that nothing else uses
FPS = 4.0
RIGHT = 0.005  # m


@dataclasses.dataclass(frozen=True)
class Shooting:
    """How films are made. The camera is turned about the middle of the tables by `around` and raised by `raised` [rad]."""

    name: str
    realism: Realism = dataclasses.field(default_factory=Realism)
    hand: HandModel = dataclasses.field(default_factory=HandModel)
    light: Light = dataclasses.field(default_factory=Light)
    manner: Manner = dataclasses.field(default_factory=Manner)
    around: float = 0.0
    raised: float = 0.0
    wider: float = 1.0


TUNED = Shooting("tuned")
HELD_OUT = Shooting(
    "held out",
    realism=Realism(blur=1.0, noise=5.0, flicker=0.06, exposure=-0.3),
    hand=HandModel(
        skin=(0.36, 0.23, 0.17),
        sleeve=(0.9, 0.9, 0.88),
        fingers=3,
        finger=0.26,
        palm=(1.2, 1.1, 0.42),
        arm=0.042,
        rise=0.8,
    ),
    light=Light(ambient=0.65, lamps=1.25, direction=(0.5, 0.7, -1.0)),
    manner=Manner(speed=0.9, uneven=2.0, tremor=0.0012, linger=0.6, side=-1.0),
    around=0.3,
    raised=0.14,
    wider=1.08,
)


@dataclasses.dataclass(frozen=True)
class Arguments:
    part: Annotated[Literal["films", "twin"], tyro.conf.Positional] = "films"
    """what series of films teach, or how often the tree of one of them works on the twin"""
    tasks: tuple[str, ...] = TASKS
    """names or YAML files"""
    series: int = 20
    """of three demonstrations each, of every task"""
    held_out: int = 10
    """the same, of the films that are held out"""
    layouts: int = 20
    """in which a tree runs on the twin, of every task"""
    first: int = 0
    """number of the first series"""
    factor: float = 1.0
    """how many times as far from perfect as a real cell the twin is, see `Realism.scaled`"""
    jobs: int = 1
    """series or runs at a time"""
    out: Path | None = None
    """where the JSON file is, to which series of films, or runs, are added"""


@dataclasses.dataclass(frozen=True)
class Run:
    """One run on the twin of a tree that a series of films taught."""

    task: str
    series: int
    tree: str
    layout: int
    factor: float
    definition: str
    code: str


@dataclasses.dataclass(frozen=True)
class Job:
    """One series of films. `definition` and `code` tell those of other tasks and versions of the package apart."""

    films: str
    task: str
    number: int
    factor: float
    definition: str
    code: str


def main(arguments: Arguments) -> None:
    console = Console(highlight=False, soft_wrap=True)
    (watched if arguments.part == "films" else run_trees)(arguments, console)


def watched(arguments: Arguments, console: Console) -> None:
    """Watch series of films and say what they taught."""
    path, code = arguments.out or RESULTS / "watching.json", code_digest(Path(__file__))
    definitions = {task: digest_of(load_task(task)) for task in arguments.tasks}
    jobs = [
        Job(shooting.name, task, number, arguments.factor, definition, code)
        for number in range(arguments.first, arguments.first + max(arguments.series, arguments.held_out))
        for shooting, count in ((TUNED, arguments.series), (HELD_OUT, arguments.held_out))
        for task, definition in (definitions.items() if number < arguments.first + count else ())
    ]
    found: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for record in accumulated(path, jobs, film_series, arguments.jobs):
        found.setdefault((record["films"], load_task(record["task"]).name), []).append(record)
        verdict = "right" if record["right"] else "WRONG"
        worst = "" if record["off"] is None else f"worst place {record['off']:.1f} mm"
        words = record["films"], Path(record["task"]).stem, record["number"], verdict, worst, record["problem"]
        console.print(*words, record["doubts"] or "", f"{record['seconds']:.0f} s", sep="  ", markup=False)
    rows = [summary(*names, arguments.factor, part) for names, part in sorted(found.items(), reverse=True)]
    report("watching", "trees from watched demonstrations", rows, out=path, fps=FPS, runs=stored(path))


def run_trees(arguments: Arguments, console: Console) -> None:
    """Run the tree of one series of each task in many layouts of the twin."""
    path, code = arguments.out or RESULTS / "watching_twin.json", code_digest()
    jobs = []
    for task in arguments.tasks:
        lesson = series(load_task(task), arguments.first, TUNED).lesson
        if lesson is not None:
            named = {"task": task, "series": arguments.first, "tree": str(lesson.tree)}
            more = {"factor": arguments.factor, "definition": digest_of(load_task(task)), "code": code}
            jobs += [Run(**named, layout=layout, **more) for layout in range(arguments.layouts)]
    found: dict[str, list[dict[str, Any]]] = {}
    for record in accumulated(path, jobs, run_on_twin, arguments.jobs):
        found.setdefault(load_task(record["task"]).name, []).append(record)
        verdict = "solved" if record["solved"] else record["reason"]
        console.print(Path(record["task"]).stem, record["layout"], verdict, sep="  ", markup=False)
    rows = [
        {
            "task": task,
            "factor": arguments.factor,
            "layouts": len(runs),
            "solved": sum(run["solved"] for run in runs),
            "mm median": float(np.median([mm for run in runs if run["solved"] for mm in run["mm"]] or [np.nan])),
            "mm worst": max((mm for run in runs if run["solved"] for mm in run["mm"]), default=float("nan")),
            "robot s": float(np.mean([run["robot s"] for run in runs])),
        }
        for task, runs in sorted(found.items())
    ]
    report("watching_twin", "trees from watched demonstrations, on the twin", rows, out=path, runs=stored(path))


def run_on_twin(job: Run) -> dict[str, Any]:
    """Return what a run came to, as JSON has it."""
    program = Program(load_task(job.task), parse_tree(job.tree))
    run = run_twin(YUMI, program, job.layout, realism=Realism().scaled(job.factor), limits=Limits(run=200.0))
    return {
        "solved": run.exit_code == Exit.DONE,
        "reason": run.outcome.reason,
        "robot s": round(run.outcome.seconds, 1),
        "mm": [round(1000 * float(distance), 2) for distance in run.distances],
    }


def film_series(job: Job) -> dict[str, Any]:
    """Return what a series taught and how it went, as JSON has it; errors in mm."""
    shooting = {each.name: each for each in (TUNED, HELD_OUT)}[job.films]
    shooting = dataclasses.replace(shooting, realism=shooting.realism.scaled(job.factor))
    result = series(load_task(job.task), job.number, shooting)
    return {
        "right": result.right,
        "problem": result.problem,
        "off": None if result.off is None else round(1000 * result.off, 2),
        "seen off": [round(1000 * error, 3) for error in result.seen_off],
        "doubts": dict(result.doubts),
        "again": result.again,
        "images": result.images,
        "seconds": round(result.seconds, 1),
    }


@dataclasses.dataclass
class Series:
    """What a series taught, and how it went; errors in m."""

    lesson: Lesson | None = None
    problem: str = ""
    right: bool = False
    off: float | None = None  # of the worst place from where it is meant to be
    seen_off: list[float] = dataclasses.field(
        default_factory=list
    )  # of where boxes were seen in their frames, from where they stood
    doubts: Counter[str] = dataclasses.field(default_factory=Counter)
    again: int = 0  # demonstrations that were not kept
    images: int = 0
    seconds: float = 0.0


def series(task: Task, number: int, shooting: Shooting) -> Series:
    """Watch one series and learn from it."""
    result, began = Series(), perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        kept = DemonstrationFolder(Path(folder) / "demos")
        kept.create(Frames.of(task))
        try:
            for i in range(DEMONSTRATIONS):
                shown(task, [SEED, number, i], shooting, kept, result)
            result.lesson = learn(kept.read(), task)
        except UserError as error:
            result.problem = str(error)
    if result.lesson is not None:
        placed = {place.args[0]: place.args for place in result.lesson.placements}
        result.right = shape(result.lesson.tree) == shape(plan_task(task))
        if result.right:
            result.off = max(
                float(np.linalg.norm(np.subtract(placed[target.object][1], target.position))) for target in task.targets
            )
            result.right = result.off <= RIGHT
    result.seconds = perf_counter() - began
    return result


def shown(task: Task, seed: list[int], shooting: Shooting, folder: DemonstrationFolder, result: Series) -> None:
    """Show one demonstration, and again where it is not kept, as a person would who is told so."""
    for attempt in range(SHOWN):
        try:
            demonstrate(task, [*seed, attempt], shooting, folder, result)
            return
        except UserError:
            result.again += 1
    raise UserError(f"not kept, {SHOWN} times")


def demonstrate(task: Task, seed: list[int], shooting: Shooting, folder: DemonstrationFolder, result: Series) -> None:
    """Film one demonstration, watch it, and keep it."""
    scene = build_scene(YUMI, task, seed, shooting.realism)
    placement, believed = placed_camera(scene, shooting)
    person = Demonstrator(scene, task.targets, np.random.default_rng(seed), shooting.manner)
    camera = FilmedDemonstration(
        scene, person, fps=FPS, hand=shooting.hand, light=shooting.light, placement=placement, seed=seed
    )
    try:
        watched = watch_demonstration(Looking(task, camera, believed), Watcher(task))
    finally:
        camera.close()
    result.images += round(person.time * FPS)
    result.doubts.update(doubt.kind for doubt in watched.doubts)
    one = demonstration_of(watched, [doubt.usual for doubt in watched.doubts], task)
    folder.append(one)
    bodies = {
        **person.poses(),
        task.kits[0].name: scene.kit,
        task.robot_frame: RigidTransform.from_translation(task.robot_position),
    }
    places = [action for action in one.actions if action.kind == "place"]
    if len(places) == len(task.targets):
        for action, target in zip(places, task.targets, strict=True):
            true = bodies[target.frame].inv().apply(bodies[target.object].translation)
            result.seen_off.append(float(np.linalg.norm(action.handled(target.frame) - true)))


def placed_camera(scene: TwinScene, shooting: Shooting) -> tuple[CameraPlacement, RigidTransform]:
    """Return where the camera is, in the world, and where it is believed to be, in the base: as wrong as in the scene."""
    task, own = scene.task, scene.camera
    base = RigidTransform.from_translation(task.robot_position)
    middle = np.mean([[*table.position[:2], table.top] for table in task.tables], axis=0)
    right = own.pose.rotation.as_matrix()[:, 0]
    turn = Rotation.from_euler("z", shooting.around) * Rotation.from_rotvec(-shooting.raised * right)
    pose = RigidTransform.from_components(middle + turn.apply(own.pose.translation - middle), turn * own.pose.rotation)
    believed = base * scene.calibrated
    shift = believed.translation - own.pose.translation
    tilt = believed.rotation * own.pose.rotation.inv()
    wrong = RigidTransform.from_components(pose.translation + shift, tilt * pose.rotation)
    return dataclasses.replace(own, pose=pose, fovy=own.fovy * shooting.wider), base.inv() * wrong


def shape(tree: object) -> str:
    """Return a tree without the numbers of its places."""
    return re.sub(r"\([-\d., e]+\)", "(..)", str(tree))


def summary(films: str, task: str, factor: float, found: list[dict[str, Any]]) -> dict[str, Any]:
    """One line of the table."""
    good = [one for one in found if one["right"]]
    off = [one["off"] for one in good]
    seen = [error for one in found for error in one["seen off"]]
    return {
        "films": films,
        "task": task,
        "factor": factor,
        "series": len(found),
        "right": len(good),
        "worst place, mm median": float(np.median(off)) if off else float("nan"),
        "worst place, mm most": max(off, default=float("nan")),
        "seen, mm median": float(np.median(seen)) if seen else float("nan"),
        "seen, mm 95 %": float(np.percentile(seen, 95)) if seen else float("nan"),
        "shown again": sum(one["again"] for one in found),
        "doubts": sum(sum(one["doubts"].values()) for one in found),
        "problems": "; ".join(one["problem"] for one in found if one["problem"]),
        "images": sum(one["images"] for one in found),
        # The median of the series, so that a pause of the machine does not count.
        "ms an image": 1000 * float(np.median([one["seconds"] / max(1, one["images"]) for one in found])),
    }


if __name__ == "__main__":
    main(tyro.cli(Arguments))
