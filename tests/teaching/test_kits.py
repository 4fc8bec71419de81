"""Demonstrations with objects of any shape, parts and slots, and what is learnt from them."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Vocabulary
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import DemonstrationFolder, Demonstrations, Frames, learn, open_questions
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import load_task
from bt_jax.teaching.script import parse_script, record
from bt_jax.teaching.teleoperation import Teleoperation
from bt_jax.training.levels import make_level
from bt_jax.training.settings import Settings

KIT4, BOLTS, FIXTURE = (load_task(name) for name in ("kit4", "bolts", "fixture"))


def session(task, seed=0):
    return Teleoperation(task, Kinematic(task), sample_layouts(task, seed, 1))


def shown(task, script, **settings):
    made = record(task, Kinematic(task), parse_script(script), **settings)
    return Demonstrations(Frames.of(task), tuple(made))


def into_slots(task):
    """The script of a person who brings everything to its slot."""
    return "; ".join(f"pick {target.object}; to {target.slot}; release" for target in task.targets)


@settings(max_examples=20)
@given(seed=st.integers(0, 100), degrees=st.floats(-360, 360), frame=st.sampled_from(["base_link", "Block"]))
def test_what_is_carried_turns_as_it_is_told(seed, degrees, frame):
    hand = session(KIT4, seed)
    hand.pick("Plate")
    where, before = hand.position("base_link"), hand.turn(frame)
    hand.turn_by(degrees)
    assert abs((hand.turn(frame) - before - degrees + 180) % 360 - 180) < 0.1
    hand.turn_to(30.0, frame)
    assert abs((hand.turn(frame) - 30 + 90) % 180 - 90) < 0.1  # a plate looks alike after half a turn
    np.testing.assert_array_equal(hand.position("base_link"), where)
    assert hand.undo()
    assert hand.undo()
    assert hand.turn(frame) == pytest.approx(before)


@settings(max_examples=20)
@given(seed=st.integers(0, 100), degrees=st.floats(-90, 90))
def test_the_recording_says_how_an_object_was_turned(seed, degrees):
    """In the frame of the kit by the pose of its own frame, and the end effector has turned with it."""
    hand = session(KIT4, seed)
    hand.pick("Plate")
    lay = hand.turn("Tray")
    hand.turn_by(degrees)
    hand.move_to((0.0, 0.0, 0.1), "Tray")
    hand.release()
    pick, place = hand.actions
    assert pick.turn("Plate", "Tray") == pytest.approx(lay, abs=0.1)
    assert abs((place.turn("Plate", "Tray") - lay - degrees + 180) % 360 - 180) < 0.1
    for action in (pick, place):
        before, after = (one.poses["Plate"].quaternion for one in (pick, action))
        assert abs(np.dot(before, after)) == pytest.approx(1, abs=1e-5)  # the grasp is rigid


def test_the_nearest_instance_of_a_part_is_picked_that_was_not_moved():
    hand = session(BOLTS, 3)
    x, y, _ = BOLTS.robot_position
    taken = []
    for _ in range(3):
        away = np.linalg.norm(hand.world.poses[0, :, :2] - [x, y], axis=1)
        away[[BOLTS.object_names.index(name) for name in taken]] = np.inf
        hand.pick("Bolt")
        assert hand.held == BOLTS.object_names[int(np.argmin(away))]
        taken.append(hand.held)
        hand.move_to((0.1 * len(taken) - 0.2, 0.0, 0.1), "TrayA")
        hand.release(lowered=True)
    assert len(set(taken)) == 3


@pytest.mark.parametrize(
    ("task", "steps", "said"),
    [
        (KIT4, "pick Plate; to Tray.slot", "there is no slot 'Tray.slot'; use one of Tray.plate, Tray.bar"),
        (KIT4, "pick Plate; to Tray.can", "Plate does not go into the slot Tray.can; carry it elsewhere"),
        (KIT4, "pick Plate; turn far", "'turn far': far is not a number of degrees; write one, such as 90"),
        (KIT4, "to Tray.can", "the gripper holds nothing; pick an object first"),
        (KIT4, "turn 90", "the gripper holds nothing; pick an object first"),
        (BOLTS, "pick Nut", "there is no object 'Nut' to pick; use one of Bolt1"),
    ],
)
def test_what_a_script_cannot_do_is_said(task, steps, said):
    with pytest.raises(UserError, match=said):
        shown(task, steps, count=1)


@pytest.mark.parametrize("task", [KIT4, BOLTS, FIXTURE], ids=lambda task: task.name)
def test_a_kit_is_learnt_and_packed_in_layouts_that_nobody_has_shown(task, tmp_path):
    folder = DemonstrationFolder(tmp_path / task.name)
    folder.create(Frames.of(task))
    for one in shown(task, into_slots(task), noise=0.001):
        folder.append(one)
    lesson = learn(folder.read(), task)
    assert not [one for one in open_questions(lesson) if one.kind != "instance"]
    assert set(lesson.targets) == set(task.targets)
    semantics = LeafSemantics(task, Vocabulary.of(leaves(lesson.tree)))
    level = make_level(task, Settings(level="kinematic"))
    assert survey(semantics, level, lesson.tree, sample_layouts(task, [9, 0], 5)).solved.all()


def test_a_turn_that_is_shown_is_learnt_without_a_slot():
    """Plate is turned by 30 degrees in the tray and Can beside it; Block is put down as it lies."""
    script = "pick Plate; to (-0.1, 0, 0.02) Tray 30; release; pick Block; to (0.15, 0, 0.045) Tray; release"
    places = [one for one in learn(shown(KIT4, script, noise=0.001), KIT4).inferences if one.kind == "place"]
    assert [(one.frame, one.turn, one.slot) for one in places] == [("Tray", 30, ""), ("Tray", None, "")]


def test_a_turn_that_nobody_shows_stays_free():
    script = "pick Plate; to (-0.1, 0, 0.02) Tray; release"
    (place,) = [one for one in learn(shown(KIT4, script, count=5), KIT4).inferences if one.kind == "place"]
    assert (place.frame, place.turn) == ("Tray", None)
    assert place.note == "the turns do not agree, so any will do"


def test_a_hand_that_comes_down_too_low_is_stopped_by_the_tray():
    """A place that is missed downwards by more than objects may sink is no error of the script."""
    assert len(list(shown(KIT4, into_slots(KIT4), noise=0.006, count=4))) == 4


@pytest.mark.parametrize("count", [2, 3])
def test_why_a_place_is_a_slot_names_no_other_frame_as_its_own(count):
    """Both trays stand on one table, so a place in one of them agrees in the other as well."""
    steps = "; ".join(f"pick Bolt; to {slot}; release" for slot in ("TrayA.r1c1", "TrayB.r1c1"))
    lesson = learn(shown(BOLTS, steps, noise=0.001, count=count), BOLTS)
    places = [one for one in lesson.inferences if one.kind == "place"]
    assert [one.slot for one in places] == ["TrayA.r1c1", "TrayB.r1c1"]
    for one, other in zip(places, ("TrayB", "TrayA"), strict=True):
        if count == 2:
            assert one.reason == "2 of 3 demonstrations needed to infer a frame, but a slot tells it"
        else:
            assert one.reason.endswith(f"in {one.frame}; {other} fits as well")


def test_sizes_of_any_shape_tell_tasks_apart(tmp_path):
    folder = DemonstrationFolder(tmp_path / "shown")
    folder.create(Frames.of(KIT4))
    assert folder.frames().recorded.difference(KIT4) is None
    assert dict(folder.frames().recorded.boxes)["Can"] == (0.035, 0.1)
    taller = [
        dataclasses.replace(one, size=(*one.size[:2], 0.12)) if one.name == "Can" else one for one in KIT4.objects
    ]
    other = dataclasses.replace(KIT4, name="taller", objects=tuple(taller))
    was, would_be = (f"0.035 m in radius and {height} m in height in" for height in ("0.1", "0.12"))
    assert folder.frames().recorded.difference(other) == f"Can measures {was} task kit4 and {would_be} taller"
    with pytest.raises(UserError, match="objects of other sizes"):
        folder.create(Frames.of(other))
