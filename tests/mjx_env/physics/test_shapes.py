"""Cuboids, cylinders and divided trays: what is put down stands there; the rest topples, rolls and comes to rest."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.mjx_env.physics import mujoco
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.scene.mjcf import timing
from bt_jax.mjx_env.world import snap, uprightness
from bt_jax.tasks import load_task
from tests.helpers.samples import MIXED

TASK = load_task(MIXED)
KITS = sample_layouts(TASK, 0, 1).kits
NAMES = TASK.object_names
TABLE, TRAY = TASK.tables[2], TASK.kits[1]
LEVELS = {"mujoco": MujocoPhysics(TASK, threads=1), "kinematic": Kinematic(TASK)}
levels = pytest.mark.parametrize("level", LEVELS.values(), ids=LEVELS)
kinds = st.sampled_from([*TASK.kinds[:-1], "Bolt1"])


def settle(physics, *placed):
    """`placed`: name, position of the middle of the foot on the third table [m], and turn [rad] about the vertical."""
    poses = np.zeros((1, len(NAMES), 7), np.float32)
    poses[..., 3] = 1
    present = np.zeros((1, len(NAMES)), bool)
    rows = [NAMES.index(name) for name, *_ in placed]
    for row, (name, (x, y, z), turn) in zip(rows, placed, strict=True):
        origin = (*TABLE.position[:2], TABLE.top + TASK.thing(name).height / 2)
        poses[0, row] = *np.add(origin, (x, y, z)), np.cos(turn / 2), 0, 0, np.sin(turn / 2)
        present[0, row] = True
    settled = physics.settle(KITS, snap(poses), present)
    assert settled.ok.all()
    return poses[0, rows], settled.poses[0, rows], settled


@levels
@given(name=kinds, x=st.floats(-0.2, 0.2), y=st.floats(-0.2, 0.2), z=st.floats(0, 0.003), turn=st.floats(-3, 3))
@settings(max_examples=15)
def test_what_is_put_down_stands_there(level, name, x, y, z, turn):
    start, rest, settled = settle(level, (name, (x, y, z), turn))
    np.testing.assert_allclose(rest[0, :3], start[0, :3] - [0, 0, z], atol=2e-4)
    assert abs(np.dot(rest[0, 3:], start[0, 3:])) > 0.999
    assert settled.steps[0] < 40


@levels
@given(
    order=st.permutations(["Plate", "Brick", "Cube", "Can"]),
    turns=st.lists(st.floats(-1.5, 1.5), min_size=4, max_size=4),
)
@settings(max_examples=10)
def test_unequal_objects_stand_on_each_other(level, order, turns):
    order.sort(key=lambda name: name == "Can")  # nothing much wider stands on it
    heights = np.cumsum([0, *(TASK.thing(name).height for name in order)])
    placed = [(name, (0, 0, heights[i] + 0.001 * i), turns[i]) for i, name in enumerate(order)]
    start, rest, _ = settle(level, *placed)
    np.testing.assert_allclose(rest[:, :2], start[:, :2], atol=2e-3)
    tops = TABLE.top + heights[:-1] + [TASK.thing(name).height / 2 for name in order]
    np.testing.assert_allclose(rest[:, 2], tops, atol=2e-3)


def test_what_stands_stays_where_it_is():
    """Layouts that are settled and snapped again and again neither creep nor sink."""
    layouts, everything = sample_layouts(TASK, 1, 6), np.ones((6, len(NAMES)), bool)
    poses = first = snap(LEVELS["mujoco"].settle(layouts.kits, layouts.poses, everything).poses)
    for _ in range(5):
        poses = snap(LEVELS["mujoco"].settle(layouts.kits, poses, everything).poses)
    np.testing.assert_array_equal(poses, first)


def in_tray(x, y, z):
    """Where a place in the divided tray is, for `settle`; z is over its plate."""
    return np.array([x, y, z + TRAY.plate - TABLE.top]) + KITS[0, 1] - [*TABLE.position[:2], 0]


@levels
@given(
    name=st.sampled_from(["Can", "Cube", "Bolt1"]),
    place=st.sampled_from(TRAY.places),
    off=st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(0, 0.003)),
    turn=st.floats(-3, 3),
)
@settings(max_examples=15)
def test_what_is_put_between_dividers_stands_there(level, name, place, off, turn):
    start, rest, _ = settle(level, (name, in_tray(*np.add([*place.position, 0], off)), turn))
    np.testing.assert_allclose(rest[0, :3], start[0, :3] - [0, 0, off[2]], atol=3e-4)
    assert abs(np.dot(rest[0, 3:], start[0, 3:])) > 0.999


@levels
@pytest.mark.parametrize("name", ["Plate", "Brick"])
@pytest.mark.parametrize("side", [-1, 1])
def test_what_is_put_where_dividers_cross_lies_on_them(level, name, side):
    crossing = in_tray(side * TRAY.inner[0] / 3, 0, TRAY.wall_height + 0.001)
    start, rest, _ = settle(level, (name, crossing, 0))
    np.testing.assert_allclose(rest[0, :3], start[0, :3] - [0, 0, 0.001], atol=3e-4)


@levels
@pytest.mark.parametrize("name", ["Plate", "Brick", "Can", "Cube", "Bolt2"])
def test_what_is_let_go_beyond_the_edge_falls_to_the_floor_and_rests_there(level, name):
    half = TABLE.size[0] / 2 + 0.1 * TASK.thing(name).size[0]
    _, rest, settled = settle(level, (name, (half, 0.02, 0.001), 0))
    assert rest[0, 2] < TASK.floor + TASK.thing(name).edge
    assert settled.steps[0] < timing(TASK).most_steps


@pytest.mark.parametrize("name", ["Can", "Bolt3"])
@pytest.mark.parametrize("slope", [0.2, 0.6, 1.2])
def test_a_cylinder_that_rolls_comes_to_rest(name, slope):
    """A toppled cylinder without friction of rolling would go on for ever."""
    poses = np.zeros((1, len(NAMES), 7), np.float32)
    thing, row = TASK.thing(name), NAMES.index(name)
    poses[0, row] = *TABLE.position[:2], TABLE.top + thing.edge, np.cos(slope), np.sin(slope), 0, 0
    settled = LEVELS["mujoco"].settle(KITS, poses, np.arange(len(NAMES))[None] == row)
    assert settled.ok.all()
    assert settled.steps[0] < timing(TASK).most_steps
    assert np.hypot(*(settled.poses[0, row, :2] - TABLE.position[:2])) < 0.3
    assert min(abs(uprightness(settled.poses[0, row, 3:])), 1 - abs(uprightness(settled.poses[0, row, 3:]))) < 1e-2


def test_objects_that_only_differ_in_name_move_alike_however_they_are_listed(monkeypatch):
    """Also where few models are kept."""
    monkeypatch.setattr(mujoco, "MODELS", 2)
    order = [6, 0, 4, 2, 1, 5, 3]
    task = dataclasses.replace(TASK, objects=tuple(TASK.objects[i] for i in order))
    rng = np.random.default_rng(0)
    layouts = sample_layouts(TASK, 2, 12)
    poses = layouts.poses.copy()
    poses[..., 2] += rng.uniform(0, 0.02, poses.shape[:2])
    present = rng.random(poses.shape[:2]) < 0.5
    expected = LEVELS["mujoco"].settle(layouts.kits, poses, present)
    found = MujocoPhysics(task, threads=1).settle(layouts.kits, poses[:, order], present[:, order])
    np.testing.assert_allclose(found.poses, expected.poses[:, order], atol=1e-4)
    np.testing.assert_array_equal(found.steps, expected.steps)


@pytest.mark.parametrize("backend", ["mujoco", pytest.param("mjx", marks=pytest.mark.slow)])
def test_a_plate_that_rocks_on_a_wall_comes_to_rest(backend):
    task = load_task("yumi_kit12")
    tray = task.kits[0]
    layouts = sample_layouts(task, 0, 8)
    present = np.array([[name == "Plate" for name in task.object_names]] * 8)
    poses = layouts.poses.copy()
    plate = task.object_names.index("Plate")
    turns = np.linspace(0.2, 0.9, 8)
    poses[:, plate, :2] = layouts.kits[:, 0, :2] + [0, tray.half[1] - 0.6 * task.thing("Plate").size[1]]
    poses[:, plate, 2] = layouts.kits[:, 0, 2] + tray.rim + 0.012
    poses[:, plate, 3], poses[:, plate, 6] = np.cos(turns / 2), np.sin(turns / 2)
    settled = make_physics(task, backend).settle(layouts.kits, poses, present)
    assert np.asarray(settled.ok).all()
    assert (np.asarray(settled.steps) < timing(task).most_steps).all()
