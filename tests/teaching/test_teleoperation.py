"""A scripted person at the gripper."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bt_jax._util.errors import UserError
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT, Frames
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import frames
from bt_jax.tasks import load_task
from bt_jax.teaching.teleoperation import Teleoperation

TASK = load_task("stack3")
RESTACK = load_task("restack")
PHYSICS = Kinematic(TASK)


def session(seed=0, task=TASK):
    return Teleoperation(task, PHYSICS, sample_layouts(task, seed, 1))


@given(
    seed=st.integers(0, 1000),
    at=st.tuples(*[st.floats(-0.3, 0.3)] * 2),
    frame=st.sampled_from(["GreenBox", "base_link"]),
)
def test_what_is_carried_goes_where_it_is_told(seed, at, frame):
    hand = session(seed)
    hand.pick("BlueBox")
    goal = (*at, 0.9)
    hand.move_to(goal, frame)
    np.testing.assert_allclose(hand.position(frame), goal, atol=1e-5)
    hand.move((0.01, -0.02, 0.03))
    np.testing.assert_allclose(hand.position(frame), np.add(goal, (0.01, -0.02, 0.03)), atol=1e-5)
    assert hand.held == "BlueBox"


@given(seed=st.integers(0, 1000))
def test_poses_in_all_frames_are_one_pose_in_the_world(seed):
    hand = session(seed)
    start = hand.world
    hand.pick("GreenBox")
    (action,) = hand.actions
    assert set(action.poses) == set(Frames.of(TASK).names)
    tips = []
    for name, pose in zip(TASK.frames, frames(start, TASK)[0].astype(float), strict=True):
        turn = Rotation.from_quat(pose[3:], scalar_first=True)
        tips.append(pose[:3] + turn.apply(action.poses[name].position))
        upright = turn * Rotation.from_quat(action.poses[name].quaternion, scalar_first=True)
        assert upright.magnitude() < 1e-5
    np.testing.assert_allclose(tips, np.broadcast_to(tips[0], (5, 3)), atol=1e-5)
    np.testing.assert_allclose(action.handled("GreenBox"), 0, atol=1e-5)
    np.testing.assert_allclose(action.poses["GreenBox"].position, (0, 0, END_EFFECTOR_HEIGHT), atol=1e-5)


def test_a_box_is_stacked_and_the_recording_says_where():
    hand = session()
    hand.pick("BlueBox")
    hand.move_to((0.0, 0.0, 0.11), "GreenBox")
    hand.release()
    demonstration = hand.demonstration("mine")
    assert [action.kind for action in demonstration.actions] == ["pick", "place"]
    np.testing.assert_allclose(demonstration.actions[1].handled("GreenBox"), (0, 0, 0.11), atol=1e-5)
    blue, green = (hand.world.poses[0, TASK.object_names.index(name), :3] for name in ("BlueBox", "GreenBox"))
    np.testing.assert_allclose(blue - green, (0, 0, 0.1), atol=2e-3)


def test_inputs_are_undone_one_by_one():
    hand = session()
    worlds = [hand.world]
    for step in (lambda: hand.pick("BlueBox"), lambda: hand.move((0.0, 0.0, 0.1)), hand.release):
        step()
        worlds.append(hand.world)
    while worlds:
        np.testing.assert_array_equal(hand.world.poses, worlds.pop().poses)
        assert hand.undo() == bool(worlds)
    assert hand.actions == ()


@pytest.mark.parametrize(
    ("inputs", "remedy"),
    [
        ([("pick", "RedBox")], "use one of YellowBox"),
        ([("pick", "BlueBox"), ("pick", "GreenBox")], "release it before"),
        ([("release",)], "pick an object first"),
        ([("move", (0.0, 0.0, 1.0))], "pick an object first"),
        ([("pick", "BlueBox"), ("move_to", (0.0, 0.0, 0.0), "BlueBox")], "use one of YellowBox"),
        ([("pick", "BlueBox"), ("move_to", (0.0, 0.0, np.nan), "GreenBox")], "three numbers"),
        ([("pick", "BlueBox"), ("demonstration",)], "release it, then finish"),
        ([("demonstration",)], "pick an object and place it"),
    ],
)
def test_what_cannot_be_done_is_said_and_changes_nothing(inputs, remedy):
    hand = session()
    for name, *arguments in inputs[:-1]:
        getattr(hand, name)(*arguments)
    before = hand.world
    name, *arguments = inputs[-1]
    with pytest.raises(UserError, match=remedy):
        getattr(hand, name)(*arguments)
    np.testing.assert_array_equal(hand.world.poses, before.poses)


def test_what_something_stands_on_cannot_be_picked():
    with pytest.raises(UserError, match="something stands on it"):
        session(task=RESTACK).pick("YellowBox")


def carried(hand, name, position, frame):
    hand.pick(name)
    hand.move_to(position, frame)
    return hand


@given(
    seed=st.integers(0, 1000),
    x=st.floats(-0.045, 0.045),
    y=st.floats(-0.045, 0.045),
    height=st.floats(0.1, 0.4),
)
def test_what_lands_on_a_box_is_where_it_was_said(seed, x, y, height):
    hand = carried(session(seed), "BlueBox", (x, y, height), "GreenBox")
    landing = hand.landing()
    assert (landing.on, landing.inside) == ("GreenBox", None)
    hand.release()
    np.testing.assert_allclose(hand.world.poses[0, 2, :3], landing.position, atol=2e-4)


@pytest.mark.parametrize(
    ("position", "frame", "name"),
    [
        ((0.0, 0.0, 0.05), "GreenBox", "GreenBox"),
        ((0.08, 0.08, -0.02), "GreenBox", "GreenBox"),
        ((0.0, 0.0, -0.02), "KittingBox", "KittingBox"),
        ((0.2, 0.0, 0.05), "KittingBox", "KittingBox"),  # in the wall
        ((0.0, 0.0, 0.0), "GreenBox", "GreenBox"),
    ],
)
def test_nothing_is_let_go_inside_another_object(position, frame, name):
    hand = carried(session(), "BlueBox", position, frame)
    before, recorded = hand.world, hand.actions
    assert hand.landing().inside == name
    with pytest.raises(UserError, match=f"BlueBox would be inside {name}; raise it"):
        hand.release()
    np.testing.assert_array_equal(hand.world.poses, before.poses)
    assert (hand.held, hand.actions) == ("BlueBox", recorded)
    hand.move((0.0, 0.0, 0.3))
    hand.release()
    assert hand.held is None


def test_nothing_is_let_go_where_it_would_fall_to_the_floor():
    hand = carried(session(), "BlueBox", (0.5, 0.0, 0.9), "base_link")
    assert hand.landing().on is None
    with pytest.raises(UserError, match=r"BlueBox would fall to the floor.*carry BlueBox over a table"):
        hand.release()
    assert hand.held == "BlueBox"


def test_the_gripper_has_an_end_to_its_reach():
    hand = session()
    hand.pick("BlueBox")
    for far in ((3.0, 0.0, 0.0), (0.0, -3.0, 0.0), (0.0, 0.0, 3.0)):
        before = hand.position("base_link")
        with pytest.raises(UserError, match="does not reach that far; carry BlueBox nearer"):
            hand.move(far)
        np.testing.assert_array_equal(hand.position("base_link"), before)


def test_moves_can_be_undone_together():
    hand = session()
    start = hand.world
    hand.pick("BlueBox")
    picked = hand.world
    for _ in range(5):
        hand.move((0.0, 0.0, 0.05))
    carried_to = hand.world
    hand.release()
    for expected in (carried_to, picked, start):
        assert hand.undo(moves_together=True)
        np.testing.assert_array_equal(hand.world.poses, expected.poses)
    assert not hand.undo(moves_together=True)


@given(seed=st.integers(0, 1000), height=st.floats(0.1, 0.5))
def test_what_is_lowered_is_recorded_where_it_stands(seed, height):
    hand = carried(session(seed), "BlueBox", (0.01, -0.02, height), "GreenBox")
    hand.release(lowered=True)
    np.testing.assert_allclose(hand.actions[1].handled("GreenBox"), (0.01, -0.02, 0.1), atol=2e-4)
    assert hand.undo()
    np.testing.assert_allclose(hand.position("GreenBox"), (0.01, -0.02, height), atol=1e-5)


@given(degrees=st.floats(-179, 179), other=st.floats(-179, 179))
def test_a_turned_object_is_turned_in_every_frame(degrees, other):
    start = sample_layouts(TASK, 0, 1)
    for index, angle in ((2, degrees), (1, other)):
        start.poses[0, index, 3:] = Rotation.from_euler("z", angle, degrees=True).as_quat(scalar_first=True)
    hand = Teleoperation(TASK, PHYSICS, start)
    hand.pick("BlueBox")
    for frame, expected in (("base_link", degrees), ("KittingBox", degrees), ("GreenBox", degrees - other)):
        assert abs((hand.turn(frame) - expected + 180) % 360 - 180) < 0.2
