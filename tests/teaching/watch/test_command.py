"""`demonstrate --watch`: a short rendered film, watched from a folder; what is asked, and what is refused."""

import dataclasses
import math
import sys

import numpy as np
import pytest

from bt_jax import demonstrate
from bt_jax._util.errors import UserError
from bt_jax.commands.arguments import DemonstrateArguments
from bt_jax.commands.watch import watch
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera import CameraError, Recorder
from bt_jax.deploy.perception.camera_file import save_camera
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.demonstrator import Demonstrator, Manner
from bt_jax.deploy.twin.filmed import FilmedDemonstration
from bt_jax.deploy.twin.settings import Realism
from bt_jax.lfd import DemonstrationFolder
from bt_jax.tasks import Target, load_task

TASK = load_task("yumi_stack")
AWAY = Target("BlueBox", (0.3, 0.9, 0.02), "base_link")  # beside the tables, out of the picture
REALISM = dataclasses.replace(Realism.perfect(), noise=1.0)
MANNER = Manner(speed=1.6, pause=0.0, linger=0.0)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory):
    """A film of YellowBox put into the kit, then of BlueBox taken away, as `Recorder` keeps it, and the camera's file."""
    folder = tmp_path_factory.mktemp("watch")
    scene = build_scene(YUMI, TASK, 3, REALISM)
    person = Demonstrator(scene, (TASK.targets[0], AWAY), np.random.default_rng(0), MANNER)
    try:
        camera = FilmedDemonstration(scene, person, fps=3.0)
    except UserError as error:
        pytest.skip(f"no software renderer here: {error}")
    recorder = Recorder(camera, folder / "film")
    try:
        while True:
            recorder.read()
    except CameraError:
        pass
    finally:
        camera.close()
    placement = scene.camera
    lens = Intrinsics(placement.matrix, np.zeros(5), placement.width, placement.height, 0.1)
    save_camera(folder / "camera.yaml", lens, CameraPose(scene.calibrated, 0.001, 8))
    return folder


def arguments(filmed, folder, **others):
    return DemonstrateArguments(
        folder, watch=True, camera=str(filmed / "film"), calibration=filmed / "camera.yaml", task="yumi_stack", **others
    )


def test_a_film_is_watched_and_what_is_in_doubt_is_decided(filmed, tmp_path, capsys, monkeypatch):
    with pytest.raises(UserError, match="no demonstration was kept: BlueBox is out of sight at the end; show it again"):
        watch(arguments(filmed, tmp_path / "demos"))
    said = capsys.readouterr().out
    for sentence in (
        "start: YellowBox, GreenBox, BlueBox, KittingBox are at rest",
        "YellowBox is moving",
        "YellowBox stands in KittingBox",
        "BlueBox is out of sight at the end",
        "done: 1 move",
    ):
        assert sentence in said
    assert not (tmp_path / "demos").exists()

    answers = iter(["what?", "k"])
    monkeypatch.setattr(sys, "stdin", type("Terminal", (), {"isatty": lambda self: True})())
    monkeypatch.setattr("rich.console.Console.input", lambda self, question: next(answers))
    watch(arguments(filmed, tmp_path / "demos"))
    kept = DemonstrationFolder(tmp_path / "demos")
    (one,) = kept.read()
    assert [action.kind for action in one.actions] == ["pick", "place"]
    assert math.dist(one.actions[1].handled("KittingBox"), TASK.targets[0].position) < 0.006
    assert kept.task() == TASK


REFUSED = [
    (("--camera", "twin"), "--camera is for watching; add --watch"),
    (("--watch",), "--watch needs a camera"),
    (("--watch", "--camera", "0"), "give --calibration with the file"),
    (("--watch", "--camera", "twin", "--noise", "0.01"), "--watch does not take --noise"),
    (("pick BlueBox", "--watch", "--camera", "twin"), "--watch does not take a script"),
    (("--watch", "--camera", "twin", "--fps", "0"), "--fps is 0; choose"),
    (("--watch", "--camera", "twin", "--idle", "nan"), "--idle is nan; choose"),
]


@pytest.mark.parametrize(("words", "message"), REFUSED)
def test_arguments_that_cannot_work_are_refused(words, message, capsys, tmp_path):
    with pytest.raises(SystemExit) as ended:
        demonstrate.main([str(tmp_path / "demos"), *words])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_a_camera_that_is_not_there_is_said(filmed, tmp_path):
    absent = dataclasses.replace(arguments(filmed, tmp_path / "demos"), camera="93")
    with pytest.raises(UserError, match="camera 93 cannot be opened; check its cable"):
        watch(absent)
