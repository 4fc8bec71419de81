"""`demonstrate --watch`: a short rendered film, watched from a folder; what is asked, and what is refused."""

import dataclasses
import math
import sys

import numpy as np
import pytest

from bt_jax import demonstrate
from bt_jax._util.errors import UserError
from bt_jax.commands import watch as command
from bt_jax.commands.arguments import DemonstrateArguments
from bt_jax.commands.watch import watch
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera import CameraError
from bt_jax.deploy.perception.camera_file import save_camera
from bt_jax.deploy.perception.film import Recorder
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.demonstrator import Demonstrator, Manner
from bt_jax.deploy.twin.filmed import FilmedDemonstration
from bt_jax.deploy.twin.settings import Realism
from bt_jax.lfd import DemonstrationFolder
from bt_jax.tasks import Target, load_task
from bt_jax.teaching.watch.moves import Doubt
from tests.helpers.watched import IN_KIT, Table
from tests.helpers.watched import watch as watched_of

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


def at_a_terminal(monkeypatch, answer):
    monkeypatch.setattr(sys, "stdin", type("Terminal", (), {"isatty": lambda self: True})())
    monkeypatch.setattr("rich.console.Console.input", lambda self, question: answer(question))


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

    asked, answers = [], iter(["what?", "a", "k"])
    at_a_terminal(monkeypatch, lambda question: asked.append(question) or next(answers))
    watch(arguments(filmed, tmp_path / "demos"))
    assert asked == ["k or l? \\[l] "] * 3, "a film cannot be shown again"
    kept = DemonstrationFolder(tmp_path / "demos")
    (one,) = kept.read()
    assert [action.kind for action in one.actions] == ["pick", "place"]
    assert math.dist(one.actions[1].handled("KittingBox"), TASK.targets[0].position) < 0.006
    assert kept.task() == TASK


def test_a_person_puts_the_boxes_back_before_every_showing_but_the_first(filmed, tmp_path, monkeypatch):
    table, happened, answers = Table(), [], iter(["a", "", "k", "", "k"])
    film = (sighting for part in (table.wait(1), table.carry("YellowBox", IN_KIT)) for sighting in part)
    _, watched = watched_of(film)
    doubt = Doubt("bumped", "BlueBox was bumped", (), "leave out")
    monkeypatch.setattr(command, "open_camera", lambda name, lens, **how: happened.append("watched") or Blind())
    monkeypatch.setattr(
        command, "watch_demonstration", lambda *given, **others: dataclasses.replace(watched, doubts=(doubt,))
    )

    def answer(question):
        happened.append("decided" if question.startswith("k, l or a?") else question.partition(" where")[0])
        return next(answers)

    at_a_terminal(monkeypatch, answer)
    watch(dataclasses.replace(arguments(filmed, tmp_path / "demos", count=2), camera="0"))
    once = ["watched", "decided"]
    assert happened == [*once, "put the boxes", *once, "put the boxes", *once]
    assert len(DemonstrationFolder(tmp_path / "demos").names()) == 2


class Blind:
    """A camera that is never looked through."""

    def read(self):
        raise CameraError("there is no image")

    def close(self):
        pass


def test_a_recording_tells_lens_and_place_of_its_camera(filmed, tmp_path, monkeypatch):
    seen = []

    def look(looking, *given, **others):
        seen.append(looking.camera.read().time)
        raise CameraError("enough")

    monkeypatch.setattr(command, "watch_demonstration", look)
    with pytest.raises(CameraError, match="enough"):
        watch(arguments(filmed, tmp_path / "demos", record=tmp_path / "films"))
    own = dataclasses.replace(arguments(filmed, tmp_path / "demos"), camera=str(tmp_path / "films"), calibration=None)
    own.check()
    with pytest.raises(CameraError, match="enough"):
        watch(own)
    assert seen[0] == seen[1]
    (tmp_path / "films" / "film1" / "camera.yaml").unlink()
    with pytest.raises(UserError, match="film1 does not tell lens and place of its camera; give --calibration"):
        watch(own)


REFUSED = [
    (("--camera", "twin"), "--camera is for watching; add --watch"),
    (("--watch",), "--watch needs a camera"),
    (("--watch", "--camera", "0"), "give --calibration with the file"),
    (("--watch", "--camera", "twin", "--noise", "0.01"), "--watch does not take --noise"),
    (("pick BlueBox", "--watch", "--camera", "twin"), "--watch does not take a script"),
    (("--watch", "--camera", "twin", "--fps", "0"), "--fps is 0; choose"),
    (("--watch", "--camera", "twin", "--idle", "nan"), "--idle is nan; choose"),
    (("--watch", "--camera", "twin", "--idle", "inf"), "--idle is inf; choose"),
    (("--watch", "--camera", "twin", "--fps", "nan"), "--fps is nan; choose"),
    (("--watch", "--camera", "twin", "--fps", "inf"), "--fps is inf; choose"),
    (("--watch", "--camera", "twin", "--task", "stack"), "of task stack is 100 mm wide"),
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
