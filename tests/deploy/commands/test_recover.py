"""recover against a twin that stands in for the robot: state, word, and home."""

import sys

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands import real_cell
from bt_jax.deploy.commands.arguments import REDUCED_SPEED, RecoverArguments
from bt_jax.deploy.commands.recover import recover_command
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.robot.yumi import YUMI
from tests.helpers.real_cells import connected
from tests.helpers.terminal import Terminal


@pytest.fixture(autouse=True)
def at_a_terminal(monkeypatch):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)


AWAY = np.array([0.2, 0.1, -0.1, 0.2, 0.0, 0.0, 0.0])


class Unasked(Terminal):
    def input(self, *_, **__):
        raise AssertionError("a person was asked")


def arms(controller):
    return controller.state()[1][-18:].reshape(2, 9)[:, :7]


@pytest.mark.realtime
@pytest.mark.slow
def test_the_arms_rise_and_go_home_once_the_word_is_typed(tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch, away=AWAY) as (controller, _, arguments):
        arguments.pop("camera")
        before = arms(controller).copy()
        person = Terminal("yes")
        with pytest.raises(UserError, match="nothing has moved"):
            recover_command(RecoverArguments(**arguments), person)
        assert "controller motoron, mode AUTO" in person.said
        assert "fingers" in person.said
        np.testing.assert_allclose(arms(controller), before, atol=1e-3)
        home = np.array([YUMI.home[arm] for arm in YUMI.arm_names])
        assert np.abs(before - home).max() > 0.15
        person = Terminal("release")
        assert recover_command(RecoverArguments(**arguments, speed=REDUCED_SPEED), person) == Exit.DONE, person.said
        assert "the arms are home" in person.said
        assert np.abs(arms(controller) - home).max() < 0.06


@pytest.mark.realtime
def test_a_camera_that_cannot_be_opened_is_told_before_anybody_is_asked(tmp_path, monkeypatch):
    def broken(*_):
        raise UserError("the camera 0 cannot be opened")

    with connected(tmp_path, monkeypatch) as (_, _, arguments):
        monkeypatch.setattr(real_cell, "open_camera", broken)
        person = Unasked("release")
        with pytest.raises(UserError, match="nothing has moved"):
            recover_command(RecoverArguments(**arguments), person)
        assert "the camera 0 cannot be opened" in person.said


def test_without_a_controller_nothing_is_asked(tmp_path):
    (tmp_path / "tree.txt").write_text("move(YellowBox, (0, 0, 0.021), KittingBox)\n")
    with pytest.raises(UserError, match="--robot"):
        recover_command(RecoverArguments(tmp_path / "tree.txt"), Terminal("release"))
    with pytest.raises(UserError, match="--speed"):
        RecoverArguments(tmp_path / "tree.txt", speed=float("nan")).check()
