"""Valid inputs of every kind, and the commands that read them without more work than needed."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.yaml_files import to_yaml
from bt_jax.behaviors import expand
from bt_jax.deploy.execution.decision import Look, decide
from bt_jax.deploy.execution.log import Log, RunLog, TickEntry
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.outcome import RunOutcome
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.execution.statuses import Context
from bt_jax.deploy.link.protocol import Counters, RobotLink
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera_file import save_camera
from bt_jax.encoding.formats.text import format_tree, parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.interpret import TreeMemory
from bt_jax.encoding.status import Status
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import load_task

__all__ = ["KINDS", "Call", "Kind"]

TREE = """
Sequence
  Fallback
    at(YellowBox, (0, 0, 0.052), KittingBox)
    Sequence
      pick(YellowBox)
      place(YellowBox, (0, 0, 0.052), KittingBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
"""
MINE = """\
extends: stack
name: mine
description: the boxes side by side
targets:
  - {object: YellowBox, position: [-0.1, 0, 0.055], frame: KittingBox}
  - {object: GreenBox, position: [0.1, 0, 0.055], frame: KittingBox}
episode: {max_ticks: 12}
"""
TRAINED = ("stack", "--generations", "1", "--population", "8", "--level", "kinematic")
TINY = ("--generations", "1", "--population", "8", "--level", "kinematic")


@dataclasses.dataclass(frozen=True)
class Call:
    """One command line: the module whose `main` takes the words; `share` of the mutants that get it. `works`: where the
    input is accepted, more is done than reading it. `needs_more`: the command refuses the valid input, too, after reading
    it."""

    module: str
    words: Callable[[Path, Path], list[str]]  # of the folder with the input, and of one for what is written
    share: float = 1.0
    works: bool = False
    needs_more: bool = False


@dataclasses.dataclass(frozen=True)
class Kind:
    """One kind of input: `make` writes a valid one into a folder."""

    make: Callable[[Path], None]
    calls: tuple[Call, ...]


def _task(folder: Path) -> None:
    (folder / "task.yaml").write_text(to_yaml(load_task("stack").to_dict()), encoding="utf-8")


def _own_task(folder: Path) -> None:
    (folder / "task.yaml").write_text(MINE, encoding="utf-8")


def _tree_text(folder: Path) -> None:
    (folder / "tree.txt").write_text(format_tree(parse_tree(TREE)), encoding="utf-8")


def _tree_xml(folder: Path) -> None:
    (folder / "tree.xml").write_text(to_xml(parse_tree(TREE)), encoding="utf-8")


def _demonstrations(folder: Path) -> None:
    task = load_task("stack")
    shown = demonstration_set(task, task.targets, count=3, rng=np.random.default_rng(0), noise=0.005)
    kept = DemonstrationFolder(folder / "demonstrations")
    kept.create(Frames.of(task))
    for one in shown.demonstrations:
        kept.append(one)


def _run_folder(folder: Path) -> None:
    from bt_jax.commands.arguments import parse_train  # JAX, which no other kind needs
    from bt_jax.commands.train import run

    run(parse_train([*TRAINED, "--out", str(folder / "made")]))
    (folder / "run").mkdir()
    for name in ("config.json", "best_tree.txt", "best_tree.xml", "checkpoint.npz", "history.csv", "result.json"):
        shutil.copyfile(folder / "made" / name, folder / "run" / name)
    shutil.rmtree(folder / "made")


def _calibration(folder: Path) -> None:
    matrix = np.array([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]])
    pose = RigidTransform.from_components([0.7, 0.0, 0.6], Rotation.from_euler("x", 3.0))
    save_camera(folder / "camera.yaml", Intrinsics(matrix, np.full(5, 0.01), 640, 480, 0.2), CameraPose(pose, 0.001, 8))
    points = {number: [0.3 + 0.05 * number, 0.02 * number, 0.01] for number in range(6)}
    (folder / "points.yaml").write_text(to_yaml(points), encoding="utf-8")
    (folder / "pictures").mkdir()


class _Still(RobotLink):
    """A link of which only its counters are asked."""

    arms = ("left", "right")

    def counters(self) -> Counters:
        return Counters(0, 0, 0, 0, 0, 0, 0)


def _log(folder: Path) -> None:
    """Write the log of a run in which boxes are seen in turn, and one is said to be picked."""
    program = Program(load_task("stack"), parse_tree(TREE))
    tree, context, look = expand(program.tree), Context(last={}), Look()
    with Log(folder / "log.jsonl") as log:
        written = RunLog(log, _Still())
        written.start(program, 0.0, Limits(), {"robot": "twin"}, dry=False)
        for tick in range(8):
            names = (*program.task.object_names, program.task.kits[0].name)[: tick + 1]
            poses = {name: RigidTransform.from_translation([0.1 * i, 0.3, 0.75]) for i, name in enumerate(names)}
            seen = Observation(0.1 * tick, poses, {"left": 0.05, "right": 0.05}, None, image=0.1 * tick)
            decision = decide(
                program, tree, seen, context, look, TreeMemory(), now=0.1 * tick, patience=Limits().look, tick=0.1
            )
            written.tick(TickEntry(0.1 * tick, seen, context, look, decision, str(decision.step), 0.001))
            records = np.zeros((2, 17))
            records[:, 0] = [0, 1]
            log.motion(("left", "right"), records, every=1)
        log.write("action", time=0.4, action="pick(YellowBox)", event="start", reason="")
        written.end(RunOutcome(Status.SUCCESS, "the tree has succeeded", 0, 0.8, 8, 0), 0.8)


def _train(folder: Path, out: Path) -> list[str]:
    return ["--task", str(folder / "task.yaml"), *TINY, "--out", str(out / "run")]


def _run_in_task(folder: Path, out: Path) -> list[str]:
    (out / "tree.txt").write_text("open_gripper\n")
    return [str(out / "tree.txt"), "--task", str(folder / "task.yaml"), "--level", "kinematic"]


def _calibrate(folder: Path, out: Path) -> list[str]:
    files = ["--file", str(folder / "camera.yaml"), "--points", str(folder / "points.yaml")]
    return ["calibrate", "base", *files, "--camera", str(folder / "pictures")]


def _exported(name: str) -> Callable[[Path, Path], list[str]]:
    return lambda folder, out: [str(folder / name), "--export", str(out / "tree.xml")]


def _played(name: str) -> Callable[[Path, Path], list[str]]:
    return lambda folder, out: [str(folder / name), "--level", "kinematic", "--task", "stack"]


def _checked(name: str) -> Call:
    return Call("check", lambda folder, out: [str(folder / name)], 0.25)


_TASK = (Call("run", _run_in_task), Call("train", _train, 0.01, works=True), _checked("task.yaml"))
KINDS: Mapping[str, Kind] = MappingProxyType(
    {
        "task": Kind(_task, _TASK),
        "task that extends another": Kind(_own_task, _TASK),
        "tree, text": Kind(
            _tree_text,
            (Call("run", _exported("tree.txt")), Call("run", _played("tree.txt"), 0.2), _checked("tree.txt")),
        ),
        "tree, XML": Kind(
            _tree_xml,
            (Call("run", _exported("tree.xml")), Call("run", _played("tree.xml"), 0.2), _checked("tree.xml")),
        ),
        "demonstrations": Kind(
            _demonstrations,
            (
                Call("demonstrate", lambda folder, out: [str(folder / "demonstrations")]),
                Call(
                    "learn",
                    lambda folder, out: [
                        *(str(folder / "demonstrations"), "--out", str(out / "learnt")),
                        *("--level", "kinematic", "--layouts", "1"),
                    ],
                    0.05,
                    works=True,
                ),
                _checked("demonstrations"),
            ),
        ),
        "run folder": Kind(
            _run_folder,
            (
                Call("run", _exported("run")),
                Call("train", lambda folder, out: ["--resume", str(folder / "run")], 0.06, works=True),
                _checked("run"),
            ),
        ),
        "calibration": Kind(
            _calibration, (Call("deploy.__main__", _calibrate, needs_more=True), _checked("camera.yaml"))
        ),
        "log": Kind(
            _log,
            (Call("deploy.__main__", lambda folder, out: ["replay", str(folder / "log.jsonl")]), _checked("log.jsonl")),
        ),
    }
)
