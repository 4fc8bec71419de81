import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.observer import Observer
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task
from tests.helpers.cells import move, run_for, running

TASK = load_task("yumi_stack")


class Seeing:
    """Sees one box, or nothing."""

    def __init__(self, box: RigidTransform):
        self.image, self.lost, self.box, self.wrong, self.times = 0.0, "", box, (), {}

    def update(self):
        self.image += 1.0

    def poses(self, now):
        return {} if self.box is None else {"YellowBox": self.box}

    def findings(self, now):
        return self.wrong

    def measured(self):
        return self.times


@pytest.fixture(scope="module")
def link():
    with running(realtime=False) as (_, link):
        yield link


@pytest.fixture
def cell(link):
    claims, seeing = {"left": "YellowBox"}, Seeing(YUMI.forward("left", link.arm("left").joints))
    observer = Observer(YUMI, TASK, link=link, perception=seeing, grasped=lambda: claims)
    link.grip("left", 0.05)
    run_for(link, 1.5)
    return observer, claims, seeing


def settle_at(link, opening, target):
    """Fingers that rest at an opening although they were told to close further, as on a box. Nothing is between them here,
    and closing goes on until something is met: they come there by opening."""
    for width in (0.0, opening):
        link.grip("left", width)
        run_for(link, 1.5)
    link._target["left"] = target


def test_holding_needs_a_claim_blocked_fingers_and_the_box_between_them(cell, link):
    observer, claims, seeing = cell
    assert observer().holding is None, "open fingers"
    settle_at(link, 0.04, 0.03)
    observer()
    assert observer().holding == "YellowBox"
    at_hand, seeing.box = seeing.box, None
    assert observer().holding == "YellowBox", "the hand hides it"
    seeing.box = at_hand * RigidTransform.from_translation([0, 0, 0.1])
    assert observer().holding is None, "it is seen elsewhere: dropped"
    seeing.box = at_hand
    claims.clear()
    assert observer().holding is None, "nobody grasped it"


def test_a_pose_that_lags_behind_a_moving_hand_is_no_dropped_box(cell, link):
    observer, _, _ = cell
    settle_at(link, 0.04, 0.03)
    observer()
    move(link, "left", by=0.4, seconds=0.8)
    run_for(link, 0.9)
    assert observer().holding == "YellowBox", "the hand was there just now"
    for _ in range(16):
        run_for(link, 0.1)
        seen = observer()
    assert seen.holding is None, "it went on without the box"


def test_fingers_that_close_on_nothing_hold_nothing(cell, link):
    observer, _, _ = cell
    link.grip("left", 0.03)
    run_for(link, 1.5)
    observer()
    assert observer().opening["left"] == pytest.approx(0.0, abs=1e-3)
    assert observer().holding is None


def test_fingers_that_pass_the_size_on_their_way_hold_nothing(cell, link):
    observer, _, _ = cell
    link.grip("left", 0.02)
    seen = []
    for _ in range(30):
        run_for(link, 0.05)
        seen.append(observer())
    assert any(abs(s.opening["left"] - 0.04) < 0.004 for s in seen)
    assert all(s.holding is None for s in seen)


def test_tells_time_openings_and_images(cell, link):
    observer, _, seeing = cell
    first = observer()
    run_for(link, 0.5)
    second = observer()
    assert second.time - first.time == pytest.approx(0.5)
    assert second.opening["left"] == pytest.approx(0.05, abs=1e-3)
    assert second.image == seeing.image == first.image + 1


def lines(link):
    """Lines of sight through the left hand, and past it."""
    hand = YUMI.forward("left", link.arm("left").joints).translation
    eye, away = hand + np.array([0.5, 0, 0.5]), np.array([0.0, 0.5, 0.0])
    through = (tuple(eye), tuple(hand - [0.1, 0, 0.1]))
    past = (tuple(eye + away), tuple(hand + away - [0.1, 0, 0.1]))
    return through, past


def test_what_an_arm_hides_is_not_hidden_by_something_unknown(cell, link):
    observer, _, seeing = cell
    through, past = lines(link)
    behind = Finding("YellowBox", "something unknown is on YellowBox", stops=True, sight=through)
    beside = dataclasses.replace(behind, sight=past)
    general = Finding("", "the picture is too soft")
    seeing.wrong = (behind, beside, general)
    assert observer().findings == (beside, general)


def test_a_box_is_missing_unless_an_arm_hides_its_place_or_it_was_grasped(cell, link):
    observer, claims, seeing = cell
    through, past = lines(link)
    seeing.wrong = (Finding("GreenBox", "GreenBox is not seen where it was last", sight=past, missing=True),)
    seeing.times = {"GreenBox": link.now()}
    run_for(link, 0.5)
    assert observer().missing == {"GreenBox"}
    seeing.wrong = (dataclasses.replace(seeing.wrong[0], sight=through),)
    assert not observer().missing
    seeing.wrong = (dataclasses.replace(seeing.wrong[0], sight=past),)
    claims["right"] = "GreenBox"
    assert not observer().missing
    del claims["right"]
    assert not observer().missing, "it was in the hand since it was measured last"
    run_for(link, 0.5)
    seeing.times = {"GreenBox": link.now()}
    run_for(link, 0.5)
    assert observer().missing == {"GreenBox"}, "it was seen after it was in the hand"


def test_what_is_missing_comes_back_from_the_log():
    missing = Finding("GreenBox", "GreenBox is not seen where it was last", missing=True)
    dark = Finding("", "the picture is too dark", stops=True)
    seen = Observation(1.0, {}, {}, None, findings=(missing, dark))
    assert Observation.from_dict(seen.to_dict()).findings == (missing, dark)
    before = seen.to_dict() | {"findings": [["", "the picture is too dark", True]]}
    assert Observation.from_dict(before).findings == (dark,)
