import dataclasses
import itertools

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Object, Target, load_task, task_names
from bt_jax.tasks.footprints import Footprint, overlap
from tests.helpers.samples import assert_same

POSITION_ERROR = 1e-4


@pytest.mark.parametrize("name", task_names())
@settings(max_examples=3)
@given(seed=st.integers(0, 2**40))
def test_layouts_are_as_the_task_says(name, seed):
    task = load_task(name)
    count = 1000 // len(task.objects) ** 2 + 20
    layouts = sample_layouts(task, seed, count)
    centres = np.array([table.position[:2] for table in task.tables])
    halves = np.array([table.size[:2] for table in task.tables]) / 2
    tops = np.array([table.top for table in task.tables])
    named = [table.name for table in task.tables]
    origin = layouts.kits[..., :2] - np.array([kit.position for kit in task.kits])
    offset = np.abs(origin[:, :, None] - centres)
    kit_tables = offset.sum(axis=-1).argmin(axis=-1)
    np.testing.assert_allclose(offset.sum(axis=-1).min(axis=-1), 0, atol=1e-6)
    thickness = np.array([kit.thickness for kit in task.kits])
    np.testing.assert_allclose(layouts.kits[..., 2], tops[kit_tables] + thickness / 2, atol=1e-6)
    for kit, on in zip(task.kits, kit_tables.T, strict=True):
        if (kit.table or task.layout.kit) == "random":
            assert set(on) == set(range(len(named)))
        else:
            assert {named[i] for i in on} == {kit.table or task.layout.kit}

    xy = layouts.poses[..., :2]
    inside = (np.abs(xy[:, :, None] - centres) <= halves - task.layout.margin + 1e-4).all(axis=-1)
    assert (inside.sum(axis=-1) == 1).all()
    table = inside.argmax(axis=-1)
    assert (table[:, :, None] != kit_tables[:, None]).all()
    stack = [task.object_names.index(name) for name in task.layout.stack]
    single = [i for i in range(len(task.objects)) if i not in stack]
    heights = np.array([thing.height for thing in task.objects])
    np.testing.assert_allclose(
        layouts.poses[:, single, 2], tops[table[:, single]] + heights[single] / 2, atol=POSITION_ERROR
    )
    for below, above in itertools.pairwise(stack):
        offset = layouts.poses[:, above, :3] - layouts.poses[:, below, :3]
        height = (heights[below] + heights[above]) / 2
        np.testing.assert_allclose(offset, np.broadcast_to([0, 0, height], offset.shape), atol=POSITION_ERROR)
    groups = [*single, *stack[:1]]
    gap = np.linalg.norm(xy[:, groups, None] - xy[:, None, groups], axis=-1) + 10 * np.eye(len(groups))
    reach = np.array([task.objects[i].reach for i in groups])
    assert gap.min() >= task.layout.spacing - 2e-4
    assert (gap - reach - reach[:, None]).min() > task.finger_room

    assert (layouts.held == -1).all()
    assert layouts.gripper_open.all()
    np.testing.assert_array_equal(layouts.poses[..., 4:6], 0)
    turned = np.degrees(2 * np.arctan2(layouts.poses[..., 6], layouts.poses[..., 3]))
    assert np.abs(turned).max() <= task.layout.turn + 0.2
    assert layouts.reached.shape == (count, len(task.subgoals))
    assert not layouts.reached.any()  # restack starts stacked; the others have no subgoal


@pytest.mark.parametrize("name", ["stack", "stack3", "pyramid", "restack"])
def test_boxes_start_in_the_published_range(name):
    """Within 0.175 m of the centre of a table, along both of its edges."""
    task = load_task(name)
    xy = sample_layouts(task, 1, 400).poses[..., :2]
    away = np.abs(xy[:, :, None] - np.array([table.position[:2] for table in task.tables])).max(axis=-1).min(axis=-1)
    assert 0.17 < away.max() < 0.175 + 1e-4


def test_layouts_follow_from_the_seed():
    task = load_task("stack")
    first = sample_layouts(task, 7, 30)
    assert_same(first, sample_layouts(task, 7, 30))
    assert_same(sample_layouts(task, 7, 5), jax.tree.map(lambda x: x[:5], first))
    for other in (8, [1, 7]):
        assert not np.array_equal(sample_layouts(task, other, 30).poses, first.poses)


def test_boxes_that_find_no_room_are_reported():
    task = load_task("stack")
    tight = dataclasses.replace(task, layout=dataclasses.replace(task.layout, spacing=5.0))
    with pytest.raises(UserError, match=r"no room.*lower layout.spacing"):
        sample_layouts(tight, 0, 1)


def test_fixed_boxes_start_where_the_task_says_and_the_others_keep_away():
    task = load_task("stack")
    places = (Target("BlueBox", (-1.1, -1.0, 0.75), "base_link"), Target("YellowBox", (-1.1, -1.0, 0.85), "base_link"))
    task = dataclasses.replace(task, layout=dataclasses.replace(task.layout, kit="TableRight", fixed=places))
    layouts = sample_layouts(task, 1, 200)
    np.testing.assert_allclose(layouts.poses[:, 2, :3], np.tile([-1.1, 0, 0.8], (200, 1)), atol=POSITION_ERROR)
    np.testing.assert_allclose(layouts.poses[:, 0, :3], np.tile([-1.1, 0, 0.9], (200, 1)), atol=POSITION_ERROR)
    away = np.linalg.norm(layouts.poses[:, 1, :2] - layouts.poses[:, 2, :2], axis=-1)
    assert away.min() >= task.layout.spacing - 2e-4
    assert np.ptp(layouts.poses[:, 1, :2], axis=0).min() > 0.3


def turned_starts(rng, *, stacked, fixed):
    """Cubes or cuboids beside one kit that start turned, two of them in a stack, or one at a fixed place."""
    task = load_task("kit4")
    sizes = rng.uniform(0.04, 0.12, (4, 3)) if rng.random() < 0.5 else np.repeat(rng.uniform(0.04, 0.12, (4, 1)), 3, 1)
    things = tuple(Object(f"Thing{i}", tuple(size), (0.5, 0.5, 0.5)) for i, size in enumerate(sizes.tolist()))
    place = Target("Thing3", (-1.0, -1.0, 0.7 + things[3].height / 2), task.robot_frame, 45.0)
    layout = dataclasses.replace(
        task.layout,
        kit="TableRight",
        spacing=0.05,
        turn=0.0 if fixed else 180.0,
        stack=("Thing0", "Thing1") if stacked else (),
        fixed=(place,) if fixed else (),
    )
    return dataclasses.replace(task, objects=things, targets=(), layout=layout, finger_room=0.0)


@pytest.mark.parametrize("fixed", [False, True])
@pytest.mark.parametrize("stacked", [False, True])
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_what_starts_turned_starts_clear_of_all_else(stacked, fixed, seed):
    task = turned_starts(np.random.default_rng(seed), stacked=stacked, fixed=fixed)
    for poses in sample_layouts(task, seed, 4).poses:
        turns = np.degrees(2 * np.arctan2(poses[:, 6], poses[:, 3])).tolist()
        each = zip(task.objects, poses[:, :2].tolist(), turns, strict=True)
        covered = [Footprint.of(thing, tuple(middle), turn) for thing, middle, turn in each]
        for one, other in itertools.combinations(range(len(covered)), 2):
            if not {task.object_names[one], task.object_names[other]} <= set(task.layout.stack):
                assert overlap(covered[one], covered[other]) < 1e-3
