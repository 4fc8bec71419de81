import dataclasses
import functools

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.scene.mjcf import timing
from bt_jax.tasks import load_task
from bt_jax.tasks.support import kit_origin


@functools.cache
def physics(name, backend="mujoco"):
    return make_physics(load_task(name), backend)


def up(height):
    return np.array([0, 0, height])


class Scene:
    """Builds problems: lengths in sizes of the box, on the first table, the kit on the second."""

    def __init__(self, name="stack3"):
        self.task = load_task(name)
        self.size = self.task.objects[0].edge
        table = self.task.tables[0]
        self.origin = np.array([*table.position[:2], table.top])
        self.half = table.size[0] / 2 / self.size
        self.kit = np.array([*self.task.tables[1].position[:2], kit_origin(self.task, self.task.tables[1])[2]])

    def solve(self, *boxes, backend="mujoco", in_kit=False):
        """`boxes` are (x, y, height of the lower face) or that and a yaw, in sizes."""
        origin = self.kit + up(self.task.kits[0].thickness / 2) if in_kit else self.origin
        poses = np.zeros((1, len(self.task.objects), 7), np.float32)
        poses[..., 3] = 1
        for i, (x, y, height, *yaw) in enumerate(boxes):
            poses[0, i, :3] = origin + self.size * np.array([x, y, height + 0.5])
            if yaw:
                poses[0, i, [3, 6]] = np.cos(yaw[0] / 2), np.sin(yaw[0] / 2)
        present = np.arange(poses.shape[1])[None] < len(boxes)
        settled = physics(self.task.name, backend).settle(self.kit[None, None].astype(np.float32), poses, present)
        settled = jax.tree.map(np.asarray, settled)
        places = (settled.poses[0, : len(boxes), :3] - origin) / self.size - [0, 0, 0.5]
        return places, settled


scales = pytest.mark.parametrize("name", ["stack3", "yumi_stack"])


@scales
@pytest.mark.parametrize("in_kit", [False, True])
@given(x=st.floats(-0.8, 0.8), y=st.floats(-0.8, 0.8), height=st.floats(0, 0.1))
@settings(max_examples=10)
def test_a_box_lands_flat_where_it_was_let_go(name, in_kit, x, y, height):
    places, settled = Scene(name).solve((x, y, height), in_kit=in_kit)
    np.testing.assert_allclose(places[0], [x, y, 0], atol=5e-3)
    assert settled.ok[0]
    assert settled.steps[0] < 30
    assert settled.reach[0, 0] < 1e-3 * Scene(name).size


@scales
@pytest.mark.parametrize("in_kit", [False, True])
@given(slips=st.lists(st.floats(-0.1, 0.1), min_size=3, max_size=3))
@settings(max_examples=10)
def test_stacks_stand(name, in_kit, slips):
    places, settled = Scene(name).solve(*((slip, 0, i + 0.02 * i) for i, slip in enumerate(slips)), in_kit=in_kit)
    np.testing.assert_allclose(places, [(slip, 0, i) for i, slip in enumerate(slips)], atol=1.5e-2)
    assert settled.steps[0] < 40


@scales
def test_stacks_neither_creep_nor_sink(name):
    scene = Scene(name)
    _, settled = scene.solve((0, 0, 0), (0.02, 0, 1.02), (0, 0.03, 2.04))
    poses = first = settled.poses
    for _ in range(10):
        again = physics(name).settle(scene.kit[None, None].astype(np.float32), poses, np.ones((1, 3), bool))
        poses = again.poses
    np.testing.assert_allclose(poses[..., :3], first[..., :3], atol=5e-3 * scene.size)


@scales
def test_a_box_over_the_edge_falls_to_the_floor(name):
    scene = Scene(name)
    table = scene.task.tables[0]
    floor = min(0.0, table.position[2] - table.size[2] / 2)
    places, settled = scene.solve((-scene.half - 0.1, 0, 0.03))
    np.testing.assert_allclose(settled.poses[0, 0, 2], floor + scene.size / 2, atol=0.02 * scene.size)
    assert places[0, 0] < -scene.half
    assert 30 < settled.steps[0] < timing(scene.task).most_steps


@scales
def test_a_box_held_by_more_than_half_stays(name):
    scene = Scene(name)
    places, _ = scene.solve((-scene.half + 0.1, 0, 0.03))
    np.testing.assert_allclose(places[0], [-scene.half + 0.1, 0, 0], atol=1e-2)


@scales
def test_kit_walls_hold(name):
    scene = Scene(name)
    inner = scene.task.kits[0].inner[0] / scene.size - 0.5
    places, _ = scene.solve((inner + 0.04, 0, 0.02), (0, -inner - 0.03, 0.02), in_kit=True)
    assert places[0, 0] < inner + 0.02
    assert places[1, 1] > -inner - 0.02
    assert (places[:, 2] < 0.05).all()


@given(overlap=st.floats(0.05, 0.8), yaw=st.floats(-0.7, 0.7))
@settings(max_examples=10)
def test_boxes_released_inside_each_other_come_apart(overlap, yaw):
    places, settled = Scene().solve((0, 0, 0), (1 - overlap, 0.1, 0.03, yaw))
    apart = np.abs(places[0] - places[1])
    assert settled.ok[0]
    assert apart.max() > 0.95
    assert np.abs(places).max() < 10


def test_absent_boxes_take_no_part():
    scene = Scene()
    poses = np.zeros((2, 3, 7), np.float32)
    poses[..., :4] = (*scene.origin + up(scene.size / 2 + 0.003), 1)
    present = np.array([[True, False, False], [False, False, True]])
    settled = physics("stack3").settle(np.repeat(scene.kit[None, None], 2, 0).astype(np.float32), poses, present)
    np.testing.assert_array_equal(settled.poses[~present], poses[~present])
    np.testing.assert_array_equal(settled.poses[0, 0], settled.poses[1, 2])
    assert (settled.reach[~present] == 0).all()


def random_problems(task, rng, count):
    """Boxes let go over the first table, a little above it or above each other; many touch, some fall off."""
    scene = Scene(task.name)
    boxes = len(task.objects)
    place = rng.uniform(-1, 1, (count, boxes, 3)) * [scene.half, scene.half, 0] + np.arange(boxes)[:, None] * [
        0,
        0,
        1.05,
    ]
    poses = np.zeros((count, boxes, 7), np.float32)
    poses[..., :3] = scene.origin + scene.size * (place + up(0.53))
    poses[..., 3] = 1
    present = rng.random((count, boxes)) < 0.7
    return np.repeat(scene.kit[None, None], count, 0).astype(np.float32), poses, present


def test_a_result_depends_on_nothing_but_the_problem():
    task = load_task("stack3")
    kit, poses, present = random_problems(task, np.random.default_rng(0), 60)
    whole = physics("stack3").settle(kit, poses, present)
    order = np.random.default_rng(1).permutation(60)[:37]
    part = make_physics(task, "mujoco", threads=1).settle(kit[order], poses[order], present[order])
    for name in ("poses", "ok", "steps", "reach"):
        np.testing.assert_array_equal(getattr(part, name), getattr(whole, name)[order])


def test_a_problem_that_is_not_finite_is_reported_not_raised():
    scene = Scene()
    poses = np.full((2, 3, 7), np.nan, np.float32)
    poses[1] = [*scene.origin + up(scene.size / 2), 1, 0, 0, 0]
    present = np.array([[True, False, False]] * 2)
    settled = physics("stack3").settle(np.repeat(scene.kit[None, None], 2, 0).astype(np.float32), poses, present)
    np.testing.assert_array_equal(settled.ok, [False, True])


def test_unequal_boxes_keep_their_own_sizes():
    task = load_task("stack3")
    boxes = tuple(
        dataclasses.replace(box, size=(size,) * 3) for box, size in zip(task.objects, (0.1, 0.06, 0.08), strict=True)
    )
    task = dataclasses.replace(task, objects=boxes)
    poses = np.zeros((3, 3, 7), np.float32)
    poses[..., :4] = -1, 0, 0.75 + 0.06, 1
    present = np.eye(3, dtype=bool)
    settled = make_physics(task, "mujoco").settle(np.zeros((3, 1, 3), np.float32), poses, present)
    np.testing.assert_allclose(settled.poses[present][:, 2], [0.8, 0.78, 0.79], atol=1e-3)


def test_choice_of_backend():
    task = load_task("stack")
    chosen = make_physics(task)
    assert chosen.name == ("mujoco" if jax.default_backend() == "cpu" else "mjx")
    with pytest.raises(UserError, match="use auto, mujoco or mjx"):
        make_physics(task, "bullet")
    if jax.default_backend() == "cpu":
        with pytest.raises(UserError, match="warp"):
            make_physics(task, "mjx", implementation="warp")


@pytest.mark.slow
@scales
def test_mjx_agrees_with_c(name):
    scene = Scene(name)
    rng = np.random.default_rng(2)
    count, boxes = 48, 3
    spread = rng.uniform(-0.3, 0.3, (count, boxes, 2))
    poses = np.zeros((count, boxes, 7), np.float32)
    poses[..., 3] = 1
    in_kit = rng.random(count) < 0.5
    base = np.where(in_kit[:, None], scene.kit + up(scene.task.kits[0].thickness / 2), scene.origin)
    stacked = rng.random(count) < 0.5
    for i in range(boxes):
        beside = np.stack([1.2 * (i - 1) + 0 * in_kit, 0 * in_kit, np.full(count, 0.53)], 1)
        above = np.stack([0 * in_kit, 0 * in_kit, np.full(count, 0.53 + 1.03 * i)], 1)
        poses[:, i, :3] = base + scene.size * np.where(stacked[:, None], above, beside)
        poses[:, i, :2] += scene.size * spread[:, i] * np.where(stacked, 0.5, 0.2)[:, None]
    present = rng.random((count, boxes)) < 0.9
    present[stacked] = True
    kit = np.repeat(scene.kit[None, None], count, 0).astype(np.float32)
    other = jax.tree.map(np.asarray, physics(name, "mjx").settle(kit, poses, present))
    reference = physics(name).settle(kit, poses, present)
    away = np.linalg.norm(other.poses[..., :3] - reference.poses[..., :3], axis=-1) / scene.size
    assert other.ok.all()
    assert (away.max(axis=1) < 0.02).mean() >= 0.97
    np.testing.assert_array_equal(other.poses[~present], poses[~present])
    falls, _ = scene.solve((-scene.half - 0.2, 0, 0.03), backend="mjx")
    assert falls[0, 2] < -1


@pytest.mark.slow
def test_mjx_lanes_change_nothing():
    from bt_jax.mjx_env.physics.mjx import MjxPhysics

    task = load_task("stack3")
    problems = random_problems(task, np.random.default_rng(3), 12)
    few, many = (jax.tree.map(np.asarray, MjxPhysics(task, lanes=lanes).settle(*problems)) for lanes in (5, 16))
    landed = np.abs(few.poses - many.poses).max(axis=(1, 2)) < 1e-3
    assert landed.mean() >= 0.75
    assert few.ok.all()
    assert many.ok.all()
