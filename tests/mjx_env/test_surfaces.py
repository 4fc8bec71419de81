import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.mjx_env.surfaces import (
    Surfaces,
    fixed_surfaces,
    object_surfaces,
    overlaps,
    standing_extents,
    support_height,
)
from bt_jax.tasks import load_task
from tests.helpers.samples import MIXED

TASK = load_task("stack")
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
