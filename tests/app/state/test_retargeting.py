import dataclasses

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.arrangement import kit_table
from bt_jax.app.state.goals import goals, target_keys
from bt_jax.app.state.retargeting import retarget, untarget
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Target, load_task, task_from_dict
from tests.helpers.trays import TRAYS

TASK = load_task("stack3")
PHYSICS = MujocoPhysics(TASK, threads=1)
START = sample_layouts(TASK, 0, 1)
HALF = TASK.objects[0].edge / 2
TRAYS_START = sample_layouts(TRAYS, 0, 1)
TRAYS_PHYSICS = MujocoPhysics(TRAYS, threads=1)


def pose(world, name):
    return world.poses[0, TASK.object_names.index(name)]


def on_table(index, x=0.0, y=0.0, z=0.0):
    return np.add(TASK.tables[index].position, (x, y, TASK.tables[index].size[2] / 2 + HALF + z))


def kit(x=0.0, y=0.0, z=0.0):
    return np.add(START.kits[0, 0], (x, y, TASK.kits[0].thickness / 2 + HALF + z))


def free_table():
    return next(i for i, table in enumerate(TASK.tables) if table.name != kit_table(TASK, START))


def where_to(task, world=None):
    return {key: goal.pose[:3] for key, goal in goals(task, START if world is None else world).items()}


def test_goals_follow_each_other():
    where = where_to(TASK)
    np.testing.assert_allclose(where["GreenBox"] - where["YellowBox"], [0, 0, 0.1], atol=1e-6)
    np.testing.assert_allclose(where["YellowBox"] - START.kits[0, 0], [0, 0, 0.052], atol=1e-6)
    two = retarget(TASK, PHYSICS, START, "YellowBox", kit(0.12))
    moved = where_to(two)
    np.testing.assert_allclose(moved["BlueBox"] - where["BlueBox"], [0.133, 0, 0], atol=2e-3)  # where the gene is


def test_a_target_is_relative_to_what_carries_it():
    where = where_to(TASK)
    on_blue = retarget(
        untarget(TASK, "BlueBox"), PHYSICS, START, "YellowBox", np.add(pose(START, "BlueBox")[:3], (0.01, 0, 0.1))
    )
    assert on_blue.targets[0] == dataclasses.replace(TASK.targets[0], position=(0.0, 0.0, 0.1), frame="BlueBox")
    beside = retarget(TASK, PHYSICS, START, "BlueBox", kit(-0.1, 0.01))
    assert beside.targets[2].frame == "KittingBox"
    assert beside.targets[2].position[:2] == (-0.1, 0.01)
    table = retarget(TASK, PHYSICS, START, "BlueBox", on_table(free_table()))
    assert table.targets[2].frame == "base_link"
    np.testing.assert_allclose(where_to(table)["BlueBox"], on_table(free_table()), atol=2e-3)
    chosen = retarget(TASK, PHYSICS, START, "BlueBox", np.add(where["YellowBox"], (0.12, 0, 0)), "YellowBox")
    assert chosen.targets[2] == dataclasses.replace(TASK.targets[2], position=(0.12, 0.0, 0.0), frame="YellowBox")


@pytest.mark.parametrize(
    ("name", "position", "frame", "says"),
    [
        ("BlueBox", (0.0, 3.0, 1.0), None, "no table there, out of reach"),
        ("BlueBox", tuple(kit(0.05)), None, "inside YellowBox"),
        ("BlueBox", tuple(kit(TASK.kits[0].inner[0])), None, "kit's wall"),
        ("BlueBox", tuple(on_table(free_table(), z=0.2)), None, "hang in the air, 200 mm"),
        ("BlueBox", tuple(kit(-0.204, -0.176, 0.041)), None, "would not stay there"),
        ("YellowBox", tuple(kit(0.13)), "GreenBox", "circular"),
        ("YellowBox", tuple(kit(0.13)), "YellowBox", "measure it from something else"),
        ("RedBox", tuple(kit()), None, "no object 'RedBox'"),
    ],
)
def test_where_no_target_can_be(name, position, frame, says):
    with pytest.raises(UserError, match=says):
        retarget(TASK, PHYSICS, START, name, np.array(position), frame)


def test_a_task_without_targets_gets_one_again():
    nothing = untarget(untarget(untarget(TASK, "BlueBox"), "GreenBox"), "YellowBox")
    assert nothing.targets == ()
    again = retarget(nothing, PHYSICS, START, "YellowBox", np.array(kit()))
    assert [target.object for target in again.targets] == ["YellowBox"]


@settings(max_examples=40)
@given(
    st.sampled_from(TASK.object_names),
    st.tuples(st.floats(-1.5, 1.5), st.floats(-0.5, 0.5), st.floats(0.7, 1.3)),
    st.sampled_from([None, *TASK.frames]),
)
def test_whatever_is_accepted_is_a_task_with_that_goal(name, position, frame):
    try:
        task = retarget(TASK, PHYSICS, START, name, np.array(position), frame)
    except UserError:
        return
    assert task_from_dict(yaml.safe_load(yaml.safe_dump(task.to_dict())), source="yaml") == task
    assert np.linalg.norm(where_to(task)[name] - position) < 0.03


def on_trays(key, x, y, z=0.05, **more):
    """The mixed task with a target over a place of TrayA, or with `tray`, of another."""
    origin = TRAYS_START.kits[0, more.pop("tray", 0)]
    return retarget(TRAYS, TRAYS_PHYSICS, TRAYS_START, key, np.add(origin, (x, y, z)).astype(float), **more)


def test_a_target_near_a_slot_is_moved_into_it_and_takes_its_turn():
    there = Target("Plate", (0.15, 0.0, 0.0125), "TrayA", 0.0, "TrayA.a2")
    spare = dataclasses.replace(TRAYS, targets=tuple(t for t in TRAYS.targets if t.object != "Can"))
    origin = TRAYS_START.kits[0, 0].astype(float)
    moved = retarget(spare, TRAYS_PHYSICS, TRAYS_START, "Plate", np.add(origin, (0.12, 0.03, 0.03)), turn=37.0)
    assert target_keys(moved)["Plate"] == there
    again = retarget(moved, TRAYS_PHYSICS, TRAYS_START, "Plate", np.add(origin, (-0.13, -0.02, 0.0125)))
    assert target_keys(again)["Plate"] == TRAYS.targets[0]
    assert task_from_dict(again.to_dict(), source="dict") == again


def test_a_slot_for_something_else_takes_nothing():
    spare = dataclasses.replace(TRAYS, targets=TRAYS.targets[1:2] + TRAYS.targets[3:])
    where = np.add(TRAYS_START.kits[0, 0], (-0.15, 0.0, 0.055)).astype(float)
    target = target_keys(retarget(spare, TRAYS_PHYSICS, TRAYS_START, "Can", where))["Can"]
    assert (target.slot, target.frame) == ("", "TrayA")


def test_a_part_has_several_targets_and_each_is_changed_alone():
    assert list(target_keys(TRAYS)) == ["Plate", "Can", "Cube", "Bolt-1", "Bolt-2"]
    moved = on_trays("Bolt-2", 0.0, 0.05, 0.033, tray=1)
    assert [target.slot for target in moved.targets[3:]] == ["TrayB.r1c1", "TrayB.r2c2"]
    more = on_trays("Bolt-3", 0.0, 0.05, 0.033, tray=1)
    assert [target.slot for target in more.targets[3:]] == ["TrayB.r1c1", "TrayB.r2c3", "TrayB.r2c2"]
    assert untarget(more, "Bolt-2").targets == (*TRAYS.targets[:4], more.targets[5])
    with pytest.raises(UserError, match="every Bolt has a target already"):
        retarget(more, TRAYS_PHYSICS, TRAYS_START, "Bolt-4", np.add(TRAYS_START.kits[0, 1], (0, -0.05, 0.033)))
    with pytest.raises(UserError, match="Bolt would be inside Bolt1"):
        on_trays("Bolt-2", -0.097, -0.048, 0.033, tray=1)


def test_a_target_is_turned_in_its_frame():
    turned = retarget(
        TRAYS, TRAYS_PHYSICS, TRAYS_START, "Cube", goals(TRAYS, TRAYS_START)["Cube"].pose[:3], "Plate", 30.0
    )
    assert target_keys(turned)["Cube"] == Target("Cube", (0.0, 0.0, 0.04), "Plate", 30.0)
    aside = Target("Cube", (0.05, 0.0, 0.04), "Plate")
    there = dataclasses.replace(TRAYS, targets=(*TRAYS.targets[:2], aside, *TRAYS.targets[3:]))
    goal = goals(there, TRAYS_START)
    # The plate ends turned by a right angle, so what lies along its x lies along the world's y.
    np.testing.assert_allclose(goal["Cube"].pose[:3] - goal["Plate"].pose[:3], [0, 0.05, 0.04], atol=1e-6)


def test_nothing_rests_on_one_of_several_since_any_may_be_elsewhere():
    over = np.add(TRAYS_START.poses[0, TRAYS.object_names.index("Bolt3"), :3].astype(float), (0, 0, 0.06))
    with pytest.raises(UserError, match="would not stay there"):
        retarget(TRAYS, TRAYS_PHYSICS, TRAYS_START, "Cube", over)
