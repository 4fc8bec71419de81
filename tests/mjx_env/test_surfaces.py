import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.surfaces import (
    TOUCH,
    Surfaces,
    fixed_surfaces,
    object_surfaces,
    outline_of,
    overlaps,
    standing_extents,
    support_height,
)
from bt_jax.tasks import Kit, Slot, Target, load_task
from bt_jax.tasks.footprints import Footprint, overlap
from tests.helpers.samples import MIXED

TASK, MIXED_TASK = load_task("stack"), load_task(MIXED)
KITTING = TASK.kits[0]
KIT = np.array([[[1, 0, 0.7525]]], np.float32)
RIM, PLATE = 0.795, 0.755


def height(x, y, half=0.05):
    surfaces = fixed_surfaces(TASK, KIT)
    usable = np.ones(surfaces.top.shape, bool)
    return support_height(surfaces, np.array([[x, y]], np.float32), np.full((1, 2), half, np.float32), usable)[0]


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        (1, 0, PLATE),
        (1.133, -0.133, PLATE),
        (1.18, 0, RIM),
        (1, 0.22, RIM),
        (1.3, 0, 0.75),
        (-1, 0, 0.75),
        (0.5, 0, 0),
        (0.4, 0, 0.75),
        (9, 9, 0),
    ],
)
def test_what_is_under_a_box(x, y, expected):
    assert height(x, y) == pytest.approx(expected, abs=1e-6)


def test_side_by_side_is_not_on_top():
    surfaces = Surfaces(*(np.array(x, np.float32) for x in ([[[0, 0]]], [[[0.05, 0.05]]], [[0.1]])))
    for gap, under in ((0.1, False), (0.0999, False), (0.097, True), (-0.1, False), (-0.097, True)):
        xy = np.array([[0, gap]], np.float32)
        assert overlaps(surfaces, xy, np.full((1, 2), 0.05, np.float32))[0, 0] == under


@given(st.integers(0, 2**32 - 1))
def test_boxes_fill_the_box_around_their_corners(seed):
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=4)
    quaternion /= np.linalg.norm(quaternion)
    pose = np.concatenate([rng.uniform(-1, 1, 3), quaternion]).astype(np.float32)
    w, x, y, z = quaternion
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = pose[:3] + (signs * 0.05) @ turn.T
    found = object_surfaces(TASK, np.broadcast_to(pose, (1, 3, 7)))
    np.testing.assert_allclose(found.centre[0, 0] + found.half[0, 0], corners[:, :2].max(axis=0), atol=1e-5)
    np.testing.assert_allclose(found.centre[0, 0] - found.half[0, 0], corners[:, :2].min(axis=0), atol=1e-5)
    np.testing.assert_allclose(found.top[0, 0], corners[:, 2].max(), atol=1e-5)


@pytest.mark.parametrize("task", [TASK, load_task(MIXED)], ids=lambda task: task.name)
def test_some_objects_stand_as_all_of_them_do(task):
    rng, count = np.random.default_rng(0), 50
    which = rng.integers(len(task.objects), size=count)
    turn = rng.normal(size=(count, 4)).astype(np.float32)
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    alike = np.broadcast_to(turn[:, None], (count, len(task.objects), 4))
    expected = standing_extents(task, alike)[np.arange(count), which]
    np.testing.assert_array_equal(standing_extents(task, turn, which), expected)
    np.testing.assert_allclose(standing_extents(task, jnp.asarray(turn), jnp.asarray(which)), expected, atol=1e-6)


def drawn(rng, task, turned):
    """The objects of a task on the ground, anywhere near the middle."""
    count = len(task.objects)
    angle = rng.uniform(-np.pi, np.pi, count) * turned
    poses = np.zeros((1, count, 7), np.float32)
    poses[0, :, :2] = rng.uniform(-0.15, 0.15, (count, 2))
    poses[0, :, 3], poses[0, :, 6] = np.cos(angle / 2), np.sin(angle / 2)
    return poses, np.degrees(angle)


@pytest.mark.parametrize("name", [MIXED, "towers"])
@given(st.integers(0, 2**32 - 1))
def test_turned_objects_lie_under_one_another_where_their_footprints_overlap(name, seed):
    task = load_task(name)
    poses, turns = drawn(np.random.default_rng(seed), task, turned=1.0)
    surfaces, things = object_surfaces(task, poses), task.objects
    for i, thing in enumerate(things):
        which = np.array([i])
        half = standing_extents(task, poses[:, i, 3:], which)[:, :2]
        found = overlaps(surfaces, poses[:, i, :2], half, outline_of(task, poses[:, i, 3:], which))[0]
        own = Footprint.of(thing, tuple(poses[0, i, :2].tolist()), float(turns[i]))
        for j, other in enumerate(things):
            there = Footprint.of(other, tuple(poses[0, j, :2].tolist()), float(turns[j]))
            depth, most = overlap(own, there), 2 * TOUCH * max(thing.size)
            if depth > most or depth < 0:
                assert found[j] == (depth > 0), (thing.name, other.name, depth)


def test_beside_a_turned_plate_is_not_on_it():
    """Though it is within the block around it that is parallel to the axes."""
    kinematic, names = Kinematic(MIXED_TASK), MIXED_TASK.object_names
    plate, can = names.index("Plate"), names.index("Can")
    poses = np.zeros((1, len(names), 7), np.float32)
    poses[..., 3] = 1
    poses[0, plate, 3:] = np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)
    top = MIXED_TASK.tables[0].top
    x, y = MIXED_TASK.tables[0].position[:2]
    poses[0, plate, :3] = x, y, top + MIXED_TASK.objects[plate].height / 2
    poses[0, can, :3] = x + 0.075, y - 0.075, top + MIXED_TASK.objects[can].height / 2
    present = np.isin(np.arange(len(names)), [plate, can])[None]
    kits = np.array([[[9, 9, 0]] * len(MIXED_TASK.kits)], np.float32)
    np.testing.assert_allclose(kinematic.settle(kits, poses, present).poses[0, can], poses[0, can], atol=1e-5)


@pytest.mark.parametrize(
    "change",
    [
        lambda task: dataclasses.replace(task, layout=dataclasses.replace(task.layout, turn=180.0)),
        lambda task: dataclasses.replace(
            task,
            layout=dataclasses.replace(task.layout, fixed=(Target("BlueBox", (0.0, 0.0, 0.0), "base_link", 30.0),)),
        ),
        lambda task: dataclasses.replace(task, targets=(dataclasses.replace(task.targets[0], turn=45.0),)),
        lambda task: dataclasses.replace(
            task, kits=(dataclasses.replace(KITTING, slots=(Slot("s", (0.0, 0.0), 45.0),)),)
        ),
    ],
    ids=["start", "fixed", "target", "slot"],
)
def test_cubes_are_met_where_they_are_once_one_may_lie_turned(change):
    """Two cubes turned by 45 degrees, corner to corner, do not fit where they do side by side."""
    task = change(TASK)
    turned = np.array([[np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)]], np.float32)
    poses = np.tile(np.array([0, 0, 0.05, *turned[0]], np.float32), (1, len(task.objects), 1))
    for x, meet in ((0.12, True), (0.15, False)):
        at, half = np.array([[x, 0]], np.float32), np.full((1, 2), 0.05, np.float32)
        under = overlaps(object_surfaces(task, poses), at, half, outline_of(task, turned, np.array([0])))
        assert (under == meet).all()


def test_a_turned_cube_wider_than_its_slot_stands_on_the_dividers():
    task = load_task("towers")
    tray = Kit("Tray", size=(0.3, 0.2), wall_height=0.03, grid=(2, 3), dividers=True)
    task = dataclasses.replace(task, kits=(tray,), targets=())
    x, y = tray.places[0].position
    kits = np.array([[[0, 0, 0.7525]]], np.float32)
    present = np.arange(len(task.objects))[None] == 0
    for degrees, bottom in ((0, tray.plate), (45, tray.rim)):
        poses = np.zeros((1, len(task.objects), 7), np.float32)
        angle = np.radians(degrees) / 2
        poses[0, 0] = x, y, 1.0, np.cos(angle), 0, 0, np.sin(angle)
        rest = Kinematic(task).settle(kits, poses, present).poses[0, 0]
        np.testing.assert_allclose(rest[2], 0.7525 + bottom + 0.04, atol=1e-5)
