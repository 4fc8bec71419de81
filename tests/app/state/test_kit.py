"""Kits that a person builds: whatever is changed, everything that names it follows."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.extents import inside, poses_now
from bt_jax.app.state.kit.complaints import complaints
from bt_jax.app.state.kit.moving import from_seen, moved_tray, point_in_tray, seen
from bt_jax.app.state.kit.new import new_kit
from bt_jax.app.state.kit.objects import (
    add_object,
    copy_object,
    count_object,
    remove_object,
    rename_object,
    shape_object,
)
from bt_jax.app.state.kit.starting import carried, first_start
from bt_jax.app.state.kit.trays import (
    add_slot,
    add_tray,
    change_slot,
    change_tray,
    copy_tray,
    remove_slot,
    remove_tray,
    rename_tray,
)
from bt_jax.tasks import Subgoal, Target, load_task, parse_task, problems, task_from_dict
from tests.helpers.trays import TRAYS

TASKS = [*map(load_task, ("stack3", "restack", "towers", "yumi_kit6", "mobile_stack")), TRAYS]
EDITS = (
    "add",
    "copy",
    "remove",
    "rename",
    "count",
    "size",
    "round",
    "tray",
    "copy tray",
    "remove tray",
    "rename tray",
    "slot",
)


def edited(task, edit, number):
    """The task after an edit of one of its things."""
    kind, kit = task.kinds[number % len(task.kinds)], task.kit_names[number % len(task.kits)]
    match edit:
        case "add":
            return add_object(task, ("cuboid", "cylinder")[number % 2])[0]
        case "copy":
            return copy_object(task, kind)[0]
        case "remove":
            return remove_object(task, kind)
        case "rename":
            return rename_object(task, kind, "Another")
        case "count":
            return count_object(task, kind, 1 + number % 4)
        case "size":
            return shape_object(task, kind, size=(0.03, 0.04, 0.02 + 0.01 * number))
        case "round":
            return shape_object(task, kind, shape="cylinder")
        case "tray":
            return add_tray(task)[0]
        case "copy tray":
            return copy_tray(task, kit)[0]
        case "remove tray":
            return remove_tray(task, kit)
        case "rename tray":
            return rename_tray(task, kit, "Crate")
    return add_slot(task, kit, (0.01 * number, 0.0))[0]


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(st.sampled_from(TASKS), st.lists(st.tuples(st.sampled_from(EDITS), st.integers(0, 9)), min_size=1, max_size=4))
def test_whatever_is_edited_can_be_shown_and_kept(task, edits):
    start = first_start(task)
    for edit, number in edits:
        try:
            after = edited(task, edit, number)
        except UserError:
            continue
        start, task = carried(task, start, after), after
        assert task_from_dict(task.to_dict(), source="kept", unfinished=True) == task
        poses = poses_now(task, start)
        assert np.isfinite(start.poses).all()
        assert all(pose[2] > min(table.top for table in task.tables) for pose in poses.values())
        complaints(task)


def test_a_new_kit_needs_a_goal_only():
    kit = new_kit(["kit_1"])
    assert kit.name == "kit_2"
    assert complaints(kit) == ("Nothing has to be anywhere yet; drag something to where it should be.",)


def test_new_things_stand_free_of_the_others():
    task = new_kit([])
    start = first_start(task)
    for _ in range(8):
        after, _ = add_object(task, "cuboid")
        task, start = after, carried(task, start, after)
    poses = poses_now(task, start)
    assert list(poses)[:3] == ["BoxA", "BoxB", "BoxC"]
    for name, pose in poses.items():
        assert not any(inside(task, name, pose, other, place) for other, place in poses.items() if other != name)


def test_a_name_is_changed_wherever_it_stands():
    lifted = Subgoal("lifted", ("holding(Plate)", "clear(Cube)"))
    renamed = rename_object(dataclasses.replace(TRAYS, subgoals=(lifted,)), "Plate", "Slab")
    assert renamed.kits[0].slots[0].takes == "Slab"
    assert renamed.targets[0].object == "Slab"
    assert renamed.targets[2].frame == "Slab"
    assert renamed.subgoals[0].conditions == ("holding(Slab)", "clear(Cube)")
    crate = rename_tray(TRAYS, "TrayA", "Crate")
    assert [target.slot for target in crate.targets][:2] == ["Crate.a1", "Crate.a2"]
    assert problems(renamed) == problems(crate) == []


@pytest.mark.parametrize(("name", "says"), [("1st", "is not a name"), ("Can", "something else is called Can")])
def test_names_that_cannot_be(name, says):
    for rename, what in ((rename_object, "Plate"), (rename_tray, "TrayA")):
        with pytest.raises(UserError, match=says):
            rename(TRAYS, what, name)


def test_what_has_gone_is_named_nowhere():
    less = remove_object(TRAYS, "Plate")
    assert [target.object for target in less.targets] == ["Can", "Bolt", "Bolt"]  # the cube stood on the plate
    assert less.kits[0].slots[0].takes == ""
    one = remove_tray(TRAYS, "TrayB")
    assert {target.frame for target in one.targets} == {"TrayA", "Plate"}
    with pytest.raises(UserError, match="is the only tray"):
        remove_tray(one, "TrayA")
    with pytest.raises(UserError, match="all that there is to move"):
        remove_object(new_kit([]), "BoxA")


def test_several_are_a_part_and_one_is_an_object():
    task = load_task("stack3")
    three = count_object(task, "YellowBox", 3)
    assert three.instances["YellowBox"] == ("YellowBox1", "YellowBox2", "YellowBox3")
    assert [target.frame for target in three.targets][:2] == ["KittingBox", "YellowBox1"]
    assert count_object(three, "YellowBox", 1) == task
    fewer = count_object(TRAYS, "Bolt", 1)
    assert [target.object for target in fewer.targets].count("Bolt") == 1
    with pytest.raises(UserError, match="17 objects are too many"):
        count_object(TRAYS, "Bolt", 14)


def test_what_stands_on_something_rises_with_it():
    task = load_task("stack3")
    start = first_start(load_task("restack"))
    taller = shape_object(task, "YellowBox", size=(0.1, 0.1, 0.2))
    assert problems(taller) == []
    assert [target.position[2] for target in taller.targets][:2] == pytest.approx([0.102, 0.15])
    restack = load_task("restack")
    below = restack.layout.stack[0]
    after = carried(restack, start, shape_object(restack, below, size=(0.1, 0.1, 0.2)))
    before, now = poses_now(restack, start), poses_now(restack, after)
    for name in restack.layout.stack[1:]:
        assert now[name][2] == pytest.approx(before[name][2] + 0.1, abs=1e-4)


def test_targets_follow_their_slots():
    moved = change_slot(TRAYS, "TrayA", "a2", position=(0.1, 0.05), name="can")
    assert moved.targets[1] == Target("Can", (0.1, 0.05, 0.0525), "TrayA", None, "TrayA.can")
    gone = remove_slot(moved, "TrayA", "can")
    assert gone.targets[1] == dataclasses.replace(moved.targets[1], slot="")
    with pytest.raises(UserError, match="has a slot a1 already"):
        change_slot(TRAYS, "TrayA", "a2", name="a1")


def test_a_tray_takes_along_what_stands_in_it():
    task = TRAYS
    start = first_start(task)
    tray, table = start.kits[0, 0], task.tables[0]
    poses = start.poses.copy()
    poses[0, 0, :3] = np.add(tray, (0.1, 0.0, 0.0325))
    start = dataclasses.replace(start, poses=poses)
    moved = moved_tray(task, start, "TrayA", np.array([*table.position[:2], table.top]))
    assert (moved.kits[0].table, moved.kits[0].position) == (table.name, (0.0, 0.0))
    after = carried(task, start, moved)
    np.testing.assert_allclose(after.poses[0, 0, :3] - after.kits[0, 0], (0.1, 0.0, 0.0325), atol=1e-5)
    with pytest.raises(UserError, match="there is no table there"):
        moved_tray(task, start, "TrayA", np.array([0.0, 5.0, 0.0]))
    assert point_in_tray(task, start, "TrayA", np.add(tray, (0.101, -0.052, 0.0))) == pytest.approx((0.1, -0.05))


@pytest.mark.parametrize("name", ["stack", "yumi_stack"])
def test_lengths_are_told_as_a_person_sees_them(name):
    task = load_task(name)
    assert seen(task, task.right[:2], signed=True) == (1.0, 0.0)
    assert from_seen(task, (0.0, 1.0), signed=True) == task.away[:2]
    assert from_seen(task, seen(task, (0.1, -0.2), signed=True), signed=True) == (0.1, -0.2)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        (
            lambda: shape_object(new_kit([]), "BoxA", size=(0.15, 0.15, 0.1)),
            "150 mm does not fit the gripper, which opens",
        ),
        (lambda: change_slot(TRAYS, "TrayA", "a2", position=(-0.1, 0.0)), "The slots a1 and a2 of TrayA overlap"),
        (lambda: change_tray(TRAYS, "TrayB", position=(0.0, 0.0)), "TrayB would overlap TrayA on TableMiddle"),
        (
            lambda: count_object(shape_object(new_kit([]), "BoxA", size=(0.2, 0.2, 0.1)), "BoxA", 16),
            "do not fit on the tables",
        ),
    ],
)
def test_what_cannot_work_is_said_and_can_still_be_shown(changed, says):
    task = changed()
    assert any(says in complaint for complaint in complaints(task)), complaints(task)
    first_start(task)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"size": (0.001, 0.2)}, "leave no room"),
        ({"grid": (0, 2)}, "one row and one column"),
        ({"grid": (20, 20), "dividers": True, "wall_thickness": 0.02}, "the dividers of TrayB leave no room"),
        ({"position": (20.0, 0.0)}, "is implausible"),
    ],
)
def test_trays_that_cannot_be(change, says):
    with pytest.raises(UserError, match=says):
        change_tray(TRAYS, "TrayB", **change)


def test_the_text_of_a_file_may_extend_the_package_only():
    assert parse_task("extends: stack\nname: mine", source="mine.yaml").targets == load_task("stack").targets
    with pytest.raises(UserError, match=r"mine.yaml, key extends: '../stack' does not come with the package"):
        parse_task("extends: ../stack\nname: mine", source="mine.yaml")
    with pytest.raises(UserError, match=r"mine.yaml, key targets: there is nothing to do"):
        parse_task("extends: stack\nname: mine\ntargets: []", source="mine.yaml")
